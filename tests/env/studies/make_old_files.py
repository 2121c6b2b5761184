"""Makes the old study files that tests open: once for each version, never again.

`python tests/env/studies/make_old_files.py` writes version-N.prefcal for the present version N.
"""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parents[1])]

if __name__ == "__main__":
    from prefcal_env.studies import Marked, Noted, Retracted
    from prefcal_env.studies.schema import VERSION
    from support.studies import small_study

    path = HERE / f"version-{VERSION}.prefcal"
    with small_study(path, answers=4) as file:
        file.append(Marked(2, "unsafe", True), Noted("an old remark"), Retracted(1))
    print(path, path.stat().st_size, "bytes")
