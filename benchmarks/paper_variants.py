"""The paper's method with its switches one by one, over logs with known truth.

    python -m benchmarks.paper_variants LOG [LOG …]
    python -m benchmarks.paper_variants [--slips 100] [--seed 1] [--gradient 16]

A LOG is a motion log with its truth beside it. Without any, runs of half an hour are simulated (services/simulator) on
lines as steep as told. Judged as docs/odometry_fusion.md says; prints a table in Markdown, a row as soon as it is done.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.odometry_cases import HEADER, Figures, given, judge, simulated
from services.odometry_fusion.motion_log_file import MotionLogError
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.settings import Config


def _paper(settings: PaperSettings) -> Config:
    return Config(method="paper", paper=settings)


VARIANTS: dict[str, Config] = {
    "wheel alone": Config(method="wheel"),
    "pitch rate as measured (`none`)": _paper(PaperSettings(pitch_correction="none")),
    "pitch constant (`constant`)": _paper(PaperSettings(pitch_correction="constant")),
    "**equation (5), four start points (default)**": _paper(PaperSettings()),
    "equation (12) (`yaw_and_roll`)": _paper(PaperSettings(pitch_correction="yaw_and_roll")),
    "one start point": _paper(PaperSettings(start_points=1)),
    "jerk test at re-adhesion": _paper(PaperSettings(jerk_at_readhesion=True)),
    "no look-back": _paper(PaperSettings(look_back_s=0.0)),
    "Ta 1.23 km/h/s": _paper(PaperSettings(detection_kmhps=1.23)),
    "β 0.3 km/h/s": _paper(PaperSettings(beta_kmhps=0.3)),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="motion logs; without any, simulated ones")
    parser.add_argument("--slips", type=int, default=100, help="of simulated logs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gradient", type=float, default=16.0, help="per mille, of simulated lines")
    asked = parser.parse_args()
    try:
        cases = [given(folder) for folder in asked.logs] or simulated(asked.slips, asked.seed, asked.gradient)
    except (MotionLogError, OSError) as error:
        parser.error(str(error))
    sys.stdout.write(HEADER + "\n")
    for name, config in VARIANTS.items():
        figures = Figures()
        for case in cases:
            judge(case, config, figures)
        sys.stdout.write(figures.line(name) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
