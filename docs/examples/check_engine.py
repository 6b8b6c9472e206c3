"""Check an engine by the cases: replace `build` by yours, which returns its step."""

from impact_gym.experiments.studies.engines.cases import read
from impact_gym.experiments.studies.engines.drive import drive
from impact_gym.experiments.studies.engines.ours import build

for name, case in read().items():
    found, exact = drive(case, build, 1e-3), case.answers["object_velocity"]
    off = 100.0 * (found["object_velocity"] / exact - 1.0)
    wrong = found["momentum_error"]
    print(f"{name}: V_p {exact:.4f} m/s, off by {off:+.2f} %, momentum {wrong:.0e}")
