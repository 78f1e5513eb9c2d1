import sys, time

sys.path[:0] = ["tests", "tests/fem"]
import os

os.environ["FENICSROM_CACHE"] = "off"
import cProfile, pstats
import test_joined_speeds as t, fenicsrom

b = time.process_time()
s = t.blade(*t.TINY)
pr = cProfile.Profile()
pr.enable()
m = fenicsrom.build_model(s)
pr.disable()
print("cpu", time.process_time() - b, "n", m.whole.model.size, m.size, m.dofs)
pstats.Stats(pr).sort_stats("cumulative").print_stats(45)
