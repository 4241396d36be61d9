//! Consistency of pairs of correspondences: the graph in which cliques are searched.

use crate::par;

/// An undirected graph as rows of bits: n²/8 bytes.
#[derive(Debug, Clone)]
pub(super) struct CompatibilityGraph {
    len: usize,
    words: usize,
    bits: Vec<u64>,
}

impl CompatibilityGraph {
    /// Builds the graph of `len` vertices with an edge if the symmetric `has_edge` returns true.
    pub(super) fn new(len: usize, has_edge: impl Fn(usize, usize) -> bool + Sync) -> Self {
        let words = len.div_ceil(64).max(1);
        let mut bits = vec![0; len * words];
        let fill = |_: &mut (), i: usize, row: &mut [u64]| {
            for j in (0..len).filter(|&j| j != i && has_edge(i, j)) {
                row[j / 64] |= 1 << (j % 64);
            }
        };
        par::for_each_row(&mut bits, words, || (), fill);
        CompatibilityGraph { len, words, bits }
    }

    /// Returns the subgraph of `vertices`, numbered by their position in the list.
    pub(super) fn induced_subgraph(&self, vertices: &[usize]) -> CompatibilityGraph {
        let words = vertices.len().div_ceil(64).max(1);
        let mut bits = vec![0; vertices.len() * words];
        for (row, &v) in bits.chunks_exact_mut(words).zip(vertices) {
            for (place, _) in vertices.iter().enumerate().filter(|&(_, &w)| self.has_edge(v, w)) {
                row[place / 64] |= 1 << (place % 64);
            }
        }
        CompatibilityGraph { len: vertices.len(), words, bits }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Number of words per row.
    pub(super) fn words_per_row(&self) -> usize {
        self.words
    }

    pub(super) fn adjacency_row(&self, v: usize) -> &[u64] {
        &self.bits[v * self.words..(v + 1) * self.words]
    }

    pub(super) fn has_edge(&self, v: usize, w: usize) -> bool {
        self.adjacency_row(v)[w / 64] >> (w % 64) & 1 == 1
    }

    pub(super) fn degree(&self, v: usize) -> usize {
        count_set_bits(self.adjacency_row(v))
    }
}

/// Counts the set bits.
pub(super) fn count_set_bits(bits: &[u64]) -> usize {
    bits.iter().map(|word| word.count_ones() as usize).sum()
}

/// Returns the positions of the set bits, ascending.
pub(super) fn set_bits(bits: &[u64]) -> impl Iterator<Item = usize> + '_ {
    bits.iter().enumerate().flat_map(|(at, &word)| {
        let next = |rest: &u64| Some(rest & (rest - 1)).filter(|&rest| rest != 0);
        std::iter::successors(Some(word).filter(|&word| word != 0), next)
            .map(move |rest| 64 * at + rest.trailing_zeros() as usize)
    })
}
