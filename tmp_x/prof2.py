import sys, time

sys.path[:0] = ["tests", "tests/fem"]
import os

os.environ["FENICSROM_CACHE"] = "off"
import cProfile, pstats
import test_rotating_bodies as t

pr = cProfile.Profile()
pr.enable()
b = time.process_time()
t.test_shaft_above_its_critical_speed_whirls_by_damping_only()
pr.disable()
print("cpu", time.process_time() - b)
pstats.Stats(pr).sort_stats("tottime").print_stats(14)
pstats.Stats(pr).sort_stats("cumulative").print_stats(30)
