"""Pages that connect laboratory and simulator, for the commands ``characterize``, ``fit`` and ``sheet``.

virtual_bench : frames of a simulated camera in the laboratory.  figures_page : figures next to their datasheet.
twin_page : frames of a twin next to frames that its fit did not use.  sheet : charts and their theory.
"""
