//! A few rows over the open states, kept as their non-zero columns: rows of Φ − I, and H.

use super::layout::{Block, CAPACITY, Layout};
use nalgebra::SMatrix;

/// `M` rows over the open states: only the columns that were put, each with its place.
///
/// A block that is not open is left out silently: the same lines serve every model, whichever blocks are on. A column may
/// be put twice; every use is linear, so the parts add.
#[derive(Clone, Copy, Debug)]
pub struct Columns<const M: usize> {
    list: [Column<M>; CAPACITY],
    len: usize,
}

/// Place and values side by side: the kernel walks through them with one pointer.
#[derive(Clone, Copy, Debug)]
struct Column<const M: usize> {
    place: usize,
    value: [f64; M],
}

impl<const M: usize> Default for Columns<M> {
    fn default() -> Self {
        let empty = Column {
            place: 0,
            value: [0.0; M],
        };
        Columns {
            list: [empty; CAPACITY],
            len: 0,
        }
    }
}

impl<const M: usize> Columns<M> {
    /// Take everything out, keep the storage (filling with zeros would cost three times the refill).
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Put the columns of one block.
    #[inline]
    pub fn put<const N: usize>(
        &mut self,
        layout: &Layout,
        block: Block<N>,
        rows: &SMatrix<f64, M, N>,
    ) {
        let Some(at) = layout.offset(block) else {
            return;
        };
        for c in 0..N {
            let mut column = [0.0; M];
            for (r, x) in column.iter_mut().enumerate() {
                *x = rows[(r, c)];
            }
            self.push(at + c, column);
        }
    }

    /// Put one column of a block.
    #[inline]
    pub fn put_axis<const N: usize>(
        &mut self,
        layout: &Layout,
        block: Block<N>,
        axis: usize,
        column: [f64; M],
    ) {
        debug_assert!(axis < N);
        if let Some(at) = layout.offset(block) {
            self.push(at + axis, column);
        }
    }

    /// Put the columns that `N` states of a block have, from `axis` on, for the states of another block as well: what acts
    /// through the sum of the two.
    pub(super) fn mirror<const N: usize, const K: usize>(
        &mut self,
        layout: &Layout,
        block: Block<N>,
        axis: usize,
        into: Block<K>,
    ) {
        let (Some(from), Some(to)) = (layout.offset(block), layout.offset(into)) else {
            return;
        };
        let from = from + axis..from + axis + K;
        let columns = *self;
        for (place, value) in columns.iter().filter(|(place, _)| from.contains(place)) {
            self.push(to + place - from.start, *value);
        }
    }

    #[inline]
    fn push(&mut self, place: usize, value: [f64; M]) {
        match self.list.get_mut(self.len) {
            Some(free) => {
                *free = Column { place, value };
                self.len += 1;
            }
            None => self.fold_and_push(place, value),
        }
    }

    /// Push onto a full list: columns that were put again are added up, which makes room, since there are no more places
    /// than the capacity.
    #[cold]
    fn fold_and_push(&mut self, place: usize, value: [f64; M]) {
        let full = *self;
        self.clear();
        for (place, value) in full.iter().chain([(place, &value)]) {
            match self.list[..self.len].iter_mut().find(|c| c.place == place) {
                Some(known) => {
                    for (x, y) in known.value.iter_mut().zip(value) {
                        *x += y;
                    }
                }
                None => self.push(place, *value),
            }
        }
    }

    /// The columns: place among the open states, and values.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (usize, &[f64; M])> {
        self.list[..self.len.min(CAPACITY)]
            .iter()
            .map(|c| (c.place, &c.value))
    }

    /// The first `L` rows alone.
    pub fn leading<const L: usize>(&self) -> Columns<L> {
        const { assert!(L <= M) };
        let mut out = Columns::default();
        for (place, value) in self.iter() {
            out.push(place, core::array::from_fn(|i| value[i]));
        }
        out
    }

    /// Product with a vector over the open states.
    pub fn times(&self, x: &States) -> [f64; M] {
        let mut out = [0.0; M];
        for (j, v) in self.iter() {
            for (o, v) in out.iter_mut().zip(v) {
                *o += v * x[j];
            }
        }
        out
    }
}

/// A vector over the open states; what lies beyond them is zero.
pub type States = [f64; CAPACITY];

/// The part of a vector that belongs to a block; `None` when the block is not open.
pub fn part<const N: usize>(
    layout: &Layout,
    x: &States,
    block: Block<N>,
) -> Option<nalgebra::SVector<f64, N>> {
    layout
        .range(block)
        .map(|r| nalgebra::SVector::from_column_slice(&x[r]))
}

#[cfg(test)]
mod tests {
    use super::super::layout::{ATTITUDE, GYRO_SCALE, VELOCITY};
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn a_closed_block_is_left_out() {
        let mut h = Columns::<3>::default();
        h.put(&Layout::default(), GYRO_SCALE, &Matrix3::identity());
        assert_eq!(h.iter().count(), 0);
    }

    #[test]
    fn columns_put_twice_add_even_past_the_capacity() {
        let layout = Layout::default();
        let mut h = Columns::<3>::default();
        for _ in 0..20 {
            h.put(&layout, VELOCITY, &Matrix3::identity());
        }
        h.put_axis(&layout, VELOCITY, 1, [0.5, 0.0, 0.0]);
        let mut x = [0.0; CAPACITY];
        (x[3], x[4], x[5]) = (1.0, 2.0, 3.0);
        assert_eq!(h.times(&x), [21.0, 40.0, 60.0]);
        assert_eq!(part(&layout, &x, ATTITUDE).unwrap().norm(), 0.0);
    }

    #[test]
    fn a_new_column_finds_room_in_a_full_list_of_repetitions() {
        let layout = Layout::default();
        let mut h = Columns::<1>::default();
        for _ in 0..CAPACITY {
            h.put_axis(&layout, VELOCITY, 0, [1.0]);
        }
        h.put_axis(&layout, ATTITUDE, 2, [7.0]);
        let columns: [(usize, f64); 2] = [(3, CAPACITY as f64), (8, 7.0)];
        assert!(h.iter().map(|(place, v)| (place, v[0])).eq(columns));
    }
}
