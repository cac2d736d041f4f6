"""Uses an installed sgtd as a newcomer would: what works here, a picture, and arrays. Ends with an error if any of it fails."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import sgtd


def command(*words: str) -> str:
    done = subprocess.run([sys.executable, "-m", "sgtd", *words], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"sgtd {' '.join(words)} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


doctor = command("doctor").splitlines()[-1]
scene = sgtd.PACKAGE_DIR / "scenes" / "spheres.xml"
command("render", str(scene), "-o", "spheres.png", "--variant", "scalar_rgb", "--spp", "1", "-D", "width=96", "-D", "height=54", "-D", "bsdf=sgtdconductor")
if not Path("spheres.png").stat().st_size:
    sys.exit("the picture is empty")
ndf = sgtd.Ndf(gamma=1.7, p=1.3, alpha=0.3)
wi = np.array([0.6, 0.0, 0.8])
if not np.isclose(ndf.g1(wi), 1.0 / (1.0 + ndf.lambda_(wi))):
    sys.exit("G1 is not 1/(1 + Lambda)")
print(f"sgtd {sgtd.__version__}, Python {sys.version.split()[0]}, Mitsuba {mi.__version__}, numpy {np.__version__}: {doctor}")
