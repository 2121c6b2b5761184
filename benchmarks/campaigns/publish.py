"""Condense raw results of `prefcal bench` to the file that `prefcal bench compare` reads.

    python benchmarks/campaigns/publish.py results/raw.parquet more/raw.parquet --out worth.parquet

Without --out it replaces the file that is published with prefcal.
"""

import argparse
from pathlib import Path

from prefcal_bench.published.plan import PUBLISHED, publish

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("raw", nargs="+", type=Path, metavar="RAW")
    parser.add_argument("--out", type=Path, metavar="FILE", default=PUBLISHED)
    options = parser.parse_args()
    frame = publish(options.raw, options.out)
    studies = frame.drop_duplicates(["agent", "loop", "taste", "seed"])
    print(f"{options.out}: {len(studies)} studies, {options.out.stat().st_size / 1e6:.2f} MB")
