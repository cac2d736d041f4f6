"""Files that every fit writes."""

from __future__ import annotations

MATERIAL, JSON, SCORES, REPORT = "material.xml", "fit.json", "scores.csv", "report.html"
FILES = (MATERIAL, JSON, SCORES, REPORT)
#: Data beside fit, where data can be rendered
SPHERE = "sphere.png"
