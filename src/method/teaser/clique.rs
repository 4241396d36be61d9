//! The largest clique, by branch and bound.
//!
//! As in PMC (Rossi, Gleich and Gebremedhin 2015): a greedy clique along the k-cores is the first
//! bound; then each vertex in order of degeneracy is searched with its later neighbours only,
//! pruned by the number of colours (Tomita and Kameda 2007) on rows of bits.

use crate::method::compatibility_graph::{CompatibilityGraph, count_set_bits, set_bits};
use crate::par;

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clique {
    /// Vertices, ascending.
    pub(super) vertices: Vec<usize>,
    /// Whether no larger clique exists; false when the search ended at its limit.
    pub(super) proved: bool,
}

/// Finds the largest clique of `graph`. The search reads at most about `steps` words of bits, a
/// limit that is the same on every machine.
pub(super) fn find_maximum_clique(graph: &CompatibilityGraph, steps: u64) -> Clique {
    let (order, cores) = degeneracy_order(graph);
    let mut best = find_greedy_clique(graph, &order, &cores);
    let mut left = steps;
    let mut later = vec![0; graph.words_per_row()];
    let mut proved = true;
    // From the densest part outwards: large cliques come early and prune the rest.
    for &v in order.iter().rev() {
        if cores[v] >= best.len() {
            let shared =
                later.iter().zip(graph.adjacency_row(v)).map(|(a, b)| a & b).collect::<Vec<u64>>();
            let able = |&w: &usize| cores[w] >= best.len();
            let candidates: Vec<usize> = set_bits(&shared).filter(able).collect();
            if candidates.len() >= best.len() {
                let part = graph.induced_subgraph(&candidates);
                let spent = (candidates.len() * candidates.len()) as u64;
                let mut search = CliqueSearch {
                    graph: &part,
                    remaining_steps: left.saturating_sub(spent),
                    clique: Vec::new(),
                    best: Vec::new(),
                    bound: best.len() - 1,
                };
                let all = first_bits(candidates.len(), part.words_per_row());
                proved &= search.expand(all);
                left = search.remaining_steps;
                if !search.best.is_empty() {
                    best = search.best.iter().map(|&place| candidates[place]).collect();
                    best.push(v);
                }
            }
        }
        if !proved {
            break;
        }
        later[v / 64] |= 1 << (v % 64);
    }
    best.sort_unstable();
    Clique { vertices: best, proved }
}

fn first_bits(len: usize, words: usize) -> Vec<u64> {
    let mut bits = vec![0; words];
    (0..len).for_each(|i| bits[i / 64] |= 1 << (i % 64));
    bits
}

/// Returns vertices from the outermost k-core inwards, and each one's core number: the greatest k
/// for which it is in a subgraph whose degrees are all at least k (Batagelj and Zaversnik 2003). A
/// clique of c vertices is within the core of c − 1.
fn degeneracy_order(graph: &CompatibilityGraph) -> (Vec<usize>, Vec<usize>) {
    let n = graph.len();
    let mut degrees: Vec<usize> = (0..n).map(|v| graph.degree(v)).collect();
    let mut bins = vec![Vec::new(); n.max(1)];
    // Reversed, so that `pop` takes the lowest index first.
    (0..n).rev().for_each(|v| bins[degrees[v]].push(v));
    let (mut order, mut cores, mut done) = (Vec::with_capacity(n), vec![0; n], vec![false; n]);
    let (mut low, mut core) = (0, 0);
    while order.len() < n {
        let Some(v) = bins[low].pop() else {
            low += 1;
            continue;
        };
        // An entry is stale when its vertex was moved to a lower bin.
        if done[v] || degrees[v] != low {
            continue;
        }
        done[v] = true;
        core = core.max(low);
        cores[v] = core;
        order.push(v);
        for w in set_bits(graph.adjacency_row(v)).filter(|&w| !done[w]) {
            degrees[w] -= 1;
            bins[degrees[w]].push(w);
        }
        low = low.saturating_sub(1);
    }
    (order, cores)
}

/// Finds the best of one greedy clique per vertex: always the candidate of the highest core next.
fn find_greedy_clique(graph: &CompatibilityGraph, order: &[usize], cores: &[usize]) -> Vec<usize> {
    let mut best: Vec<usize> = order.last().copied().into_iter().collect();
    for &v in order.iter().rev().filter(|&&v| cores[v] > 0).take(MAX_GREEDY_STARTS) {
        if cores[v] < best.len() {
            continue;
        }
        let mut clique = vec![v];
        let mut candidates: Vec<usize> =
            set_bits(graph.adjacency_row(v)).filter(|&w| cores[w] >= best.len()).collect();
        // Stable: equals stay in order of index.
        candidates.sort_by(|&a, &b| cores[b].cmp(&cores[a]));
        for w in candidates {
            if clique.iter().all(|&u| graph.has_edge(u, w)) {
                clique.push(w);
            }
        }
        if clique.len() > best.len() {
            best = clique;
        }
    }
    best
}

/// Vertices from which a greedy clique is grown. Chosen by hand.
const MAX_GREEDY_STARTS: usize = 1000;

struct CliqueSearch<'a> {
    graph: &'a CompatibilityGraph,
    remaining_steps: u64,
    clique: Vec<usize>,
    best: Vec<usize>,
    /// Only larger cliques are relevant.
    bound: usize,
}

impl CliqueSearch<'_> {
    /// Searches the cliques of `chosen` and any of `candidates`; false if the steps ran out.
    fn expand(&mut self, mut candidates: Vec<u64>) -> bool {
        if self.remaining_steps == 0 {
            return false;
        }
        par::checkpoint();
        let (vertices, colors) = self.color_vertices(&candidates);
        // The last colours first; as soon as one has too few, all before it do.
        for (&v, &color) in vertices.iter().zip(&colors).rev() {
            if self.clique.len() + color <= self.bound {
                return true;
            }
            self.clique.push(v);
            let rest: Vec<u64> =
                candidates.iter().zip(self.graph.adjacency_row(v)).map(|(a, b)| a & b).collect();
            if rest.iter().any(|&word| word != 0) {
                if !self.expand(rest) {
                    return false;
                }
            } else if self.clique.len() > self.bound {
                (self.bound, self.best) = (self.clique.len(), self.clique.clone());
            }
            self.clique.pop();
            candidates[v / 64] &= !(1 << (v % 64));
        }
        true
    }

    /// Colours `candidates` so that neighbours differ; vertices by ascending colour, from 1.
    /// No clique has more vertices than colours.
    fn color_vertices(&mut self, candidates: &[u64]) -> (Vec<usize>, Vec<usize>) {
        let size = count_set_bits(candidates);
        let (mut vertices, mut colors) = (Vec::with_capacity(size), Vec::with_capacity(size));
        let mut uncolored = candidates.to_vec();
        let mut color = 0;
        while vertices.len() < size {
            color += 1;
            let mut free = uncolored.clone();
            // A vertex only excludes later ones, so one pass over the words is enough.
            for at in 0..free.len() {
                while free[at] != 0 {
                    let v = 64 * at + free[at].trailing_zeros() as usize;
                    vertices.push(v);
                    colors.push(color);
                    uncolored[at] &= !(1 << (v % 64));
                    free[at] &= !(1 << (v % 64));
                    let row = self.graph.adjacency_row(v);
                    free[at..].iter_mut().zip(&row[at..]).for_each(|(word, &bits)| *word &= !bits);
                }
            }
        }
        self.remaining_steps =
            self.remaining_steps.saturating_sub(((size + color) * candidates.len()) as u64);
        (vertices, colors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(graph: &CompatibilityGraph) -> usize {
        let clique = |subset: u32| {
            let members: Vec<usize> = (0..graph.len()).filter(|v| subset >> v & 1 == 1).collect();
            members.iter().all(|&v| members.iter().all(|&w| v == w || graph.has_edge(v, w)))
        };
        (0..1u32 << graph.len())
            .filter(|&subset| clique(subset))
            .map(|subset| subset.count_ones() as usize)
            .max()
            .unwrap_or(0)
    }

    proptest! {
        #[test]
        fn it_is_as_large_as_by_brute_force(
            n in 0..14usize,
            edges in proptest::collection::vec(0.0..1.0f64, 91),
            density in 0.05..0.95f64,
        ) {
            let edge = |i: usize, j: usize| edges[i.max(j) * (i.max(j) - 1) / 2 + i.min(j)] < density;
            let graph = CompatibilityGraph::new(n, edge);
            let found = find_maximum_clique(&graph, u64::MAX);
            prop_assert!(found.proved);
            prop_assert_eq!(found.vertices.len(), brute(&graph));
            for &v in &found.vertices {
                prop_assert!(found.vertices.iter().all(|&w| v == w || graph.has_edge(v, w)));
            }
        }
    }

    /// Hashes pairs into [0, 1), deterministically.
    fn noise(i: usize, j: usize) -> f64 {
        let seed = (i.max(j) * 7919 + i.min(j)) as u64;
        let mixed = (seed ^ (seed >> 7)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> 40) as f64 / (1u64 << 24) as f64
    }

    #[test]
    fn a_planted_clique_among_many_is_found_and_proved() {
        let planted = |v: usize| v.is_multiple_of(37);
        let edge = |i: usize, j: usize| (planted(i) && planted(j)) || noise(i, j) < 0.05;
        let graph = CompatibilityGraph::new(1500, edge);
        let found = find_maximum_clique(&graph, 1_000_000_000);
        assert!(found.proved);
        assert_eq!(found.vertices, (0..1500).filter(|&v| planted(v)).collect::<Vec<_>>());
    }

    #[test]
    fn without_steps_the_greedy_clique_is_not_proved() {
        let graph = CompatibilityGraph::new(400, |i, j| noise(i, j) < 0.6);
        let found = find_maximum_clique(&graph, 1);
        assert!(!found.proved && found.vertices.len() > 3);
        assert_eq!(found, find_maximum_clique(&graph, 1));
    }
}
