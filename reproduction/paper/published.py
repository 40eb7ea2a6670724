"""What section 4 of Konnik & Welsh 2014 prints, as numbers, and why some of it cannot be measured again."""

from __future__ import annotations

from typing import NamedTuple

PRNU_MEAN_DN, PRNU_SIGMA_DN, PRNU_PERCENT = 1520.0, 7.9, 0.52  # §PRNU, hardware
PRNU_SPECIFIED_PERCENT = 0.50  # Table 1


class NonWhiteness(NamedTuple):
    """A row of Table 2: F ± its standard deviation over 100 measurements, hardware and simulated."""

    name: str
    time_s: float
    share: float  # of saturation
    hardware: tuple[float, float]
    simulated: tuple[float, float]


TABLE_2 = (
    NonWhiteness("darkness", 0.05, 0.0, (0.999, 0.018), (0.999, 0.002)),  # Table 2
    NonWhiteness("darkness", 0.1, 0.0, (1.032, 0.020), (0.999, 0.002)),  # Table 2
    NonWhiteness("50 % saturation", 0.05, 0.5, (1.062, 0.018), (0.999, 0.002)),  # Table 2
    NonWhiteness("90 % saturation", 0.1, 0.9, (1.079, 0.020), (0.998, 0.002)),  # Table 2
)


class PublishedSignal(NamedTuple):
    """Distribution of an averaged dark frame [DN]: the main family, and what is superimposed on it."""

    figure: str
    time_s: float
    family: str  # as the laboratory names it
    parameters: tuple[float, float]  # µ, σ of ln x [ln DN]; or a [1] and b [DN]
    uniform: tuple[float, float] | None = None  # its ends [DN]
    normal: tuple[float, float] | None = None  # µ, σ [DN]

    @property
    def parts(self) -> tuple[str, ...]:
        """As the laboratory fits them."""
        found = {"uniform": self.uniform, "normal": self.normal}
        return (self.family, *(name for name, part in found.items() if part))


DARK_SIGNALS = (
    PublishedSignal("Fig. 8", 0.001, "log-normal", (4.0241, 0.033)),  # §Short integration time
    PublishedSignal("Fig. 9", 100.0, "log-normal", (4.0246, 0.035)),  # §Short integration time
    PublishedSignal(
        "Fig. 10", 150.0, "gamma", (914.6579, 0.0611), (45.0, 440.0)
    ),  # §Long integration time
    PublishedSignal(
        "Fig. 11", 300.0, "gamma", (627.200, 0.0893), (50.0, 460.0), (18.0, 4.0)
    ),  # §Long integration time
)
NORMAL_AT_1_MS = (55.9531, 1.6712)  # §Short integration time: µ and σ of the normal fit [DN]

RELEASED_SNR = {"linear": 162.1, "V/V 1.05 + ADC 1.04": 195.5}
"""Of the authors' released code (ominux/highlevelsensorsim @ 63afec6, run in GNU Octave 7.3) at 1984 DN, without column
offsets: 1983.7 DN over 12.241 DN, and 1983.8 DN over 10.147 DN."""

NOT_TO_BE_MET = (
    (
        "Fig. 2, 3, 4, 5, 6a",
        "The curves of the hardware are printed without data, so nothing stands beside ours but the text's numbers.",
    ),
    (
        "Fig. 7",
        "Dark histograms of the hardware at 100 to 600 s, for which the text has no parameters and no data.",
    ),
    (
        "Fig. 2",
        "Why the hardware is noisier at short times is put down to an undisclosed CDS; a camera file has no number "
        "of it.",
    ),
    (
        "Fig. 4",
        "The text says that the linear model overestimates the SNR. At equal DN the pair V/V 1.05 and ADC 1.04 "
        "raises it by 1.3 to 2.9 % with a converter that takes the non-linear swing of a full well, lowers it by "
        "0.8 % at most with one of 0.165 V, and raises it by 21 % in the authors' released code.",
    ),
    (
        "Table 2, darkness",
        "Table 1's column offsets are 4.1 DN, above the temporal noise of darkness; offsets alone have F = 1/ln 2 = "
        "1.443, so F = 0.999 holds only without them.",
    ),
    (
        "Fig. 8",
        "A sample of the published log-normal distribution has σ = 1.848 DN; the normal fit to the same histogram is "
        "printed with σ = 1.6712 DN: both cannot hold.",
    ),
    (
        "Fig. 8 to 11",
        "The main component lies at 55.9 to 56.0 DN at 1 ms, 100, 150 and 300 s: an offset and not dark current, of "
        "which Table 1's 1 nA/cm² fills the well in 19 s at 25 °C; we give each exposure the dark signal that is "
        "printed for it.",
    ),
    (
        "Fig. 8",
        "Table 1's column offsets of 4.1 DN are wider than the whole published histogram (1.7 DN); ours is without "
        "them.",
    ),
    (
        "Fig. 10, 11",
        "Weights of the superimposed components are not printed; we take 1 % for each.",
    ),
    (
        "Fig. 10",
        "“The product of two uniform distributions on [45, 440]” would lie between 2025 and 193 600; we take one "
        "uniform distribution on that interval.",
    ),
)
"""Figure or table, and one sentence."""
