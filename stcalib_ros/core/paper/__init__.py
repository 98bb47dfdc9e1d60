"""The paper's own method (Lee, Nishino, Nobuhara 2025), stage by stage.

Two-view registration (Section III): `oriented` (oriented points of windows of T frames), `vmf`
(von Mises-Fisher distributions), `em` (responsibilities, mixing proportions, rotation),
`matching` (bipartite matching), `registration` (offsets by brute force, RANSAC), `translation`
(epipolar constraint). Multi-view (Section IV): `posegraph`, `merge` (spanning tree), `stba`.
`stages` calls them in order for the pipeline. The protocol of the paper's pairwise experiments is
in `benchmarks.paper`, the errors of every stage in `stcalib_ros.core.evaluation.stage_errors`.
"""
