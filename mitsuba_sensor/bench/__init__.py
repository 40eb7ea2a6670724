"""Where laboratory and simulator meet: pages of the commands ``characterize`` and ``fit``.

virtual_bench : the frames that a laboratory takes, of a simulated camera; rendered_field : in light that is rendered.
figures_page : figures of a camera beside its datasheet (datasheet).  twin_page : frames of a twin
beside frames that its fit did not see.
"""
