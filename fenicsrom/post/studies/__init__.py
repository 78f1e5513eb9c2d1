"""Reports of comparisons, sweeps, Campbell diagrams, stability and meshes."""
