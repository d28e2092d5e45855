"""Draws how much halving the window changes impulses, from the table that a test prints:

    cargo test --release --test component halving -- --nocapture | python3 scripts/plot_windows.py docs/src/images/windows.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# The words of docs/src/coupling/windows.md.
NAMES = {"Hermite": "cubic", "Linear": "linear", "Hold": "held"}

curves = {}
for line in sys.stdin:
    words = line.split()
    if len(words) == 4 and words[1] in NAMES:
        curves.setdefault(NAMES[words[1]], []).append((float(words[0]) * 1e-3, 100 * float(words[2])))
if not curves:
    sys.exit("no table on stdin; see the first lines of this file")
figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
for name, points in curves.items():
    ax.loglog(*zip(*points), "o-", label=name)
ax.set_xticks([1, 2, 4], labels=["1", "2", "4"])
ax.minorticks_off()
ax.axhline(1.0, color="grey", lw=0.8, ls="--", label="1 %")
ax.set(
    title="35 Hz, 5 mm: what halving the window changes",
    xlabel="length of the window, ms",
    ylabel="change of the impulse in 4 ms, % of the largest",
)
ax.grid(alpha=0.3, which="both")
ax.legend()
figure.savefig(sys.argv[1], dpi=110)
print(sys.argv[1])
