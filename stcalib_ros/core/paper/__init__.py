"""The paper's own method (Lee, Nishino, Nobuhara 2025), stage by stage.

Two-view registration (Section III): `oriented` (oriented points of windows of T frames), `vmf`
(von Mises-Fisher distributions), `em` (responsibilities, mixing proportions, rotation),
`matching` (bipartite matching), `registration` (offsets by brute force, RANSAC), `translation`
(epipolar constraint). Multi-view (Section IV): `posegraph`, `merge` (spanning tree), `stba`.
`stages` strings them together, `pairs` is the protocol of the paper's pairwise experiments for
either method, and `judge` holds every stage against the truth.
"""
