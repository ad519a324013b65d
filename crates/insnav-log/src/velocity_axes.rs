//! Axes of GNSS velocity messages, where a driver does not give east, north, up.

use nalgebra::{Matrix3, Vector3};
use std::fmt;
use std::str::FromStr;

/// Where the x, y and z of a velocity message point: `enu`, `ned`, or any other three letters of e/w, n/s and u/d.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityAxes {
    /// Which component of the message lies along east, north and up.
    component: [usize; 3],
    /// Whether it points the other way.
    reversed: [bool; 3],
}

impl Default for VelocityAxes {
    fn default() -> Self {
        VelocityAxes {
            component: [0, 1, 2],
            reversed: [false; 3],
        }
    }
}

/// Letters of the axes and of their opposites, east, north, up.
const LETTERS: [[char; 2]; 3] = [['e', 'w'], ['n', 's'], ['u', 'd']];

impl VelocityAxes {
    /// North, east, down, as arrays have them.
    pub(crate) const NED: Self = VelocityAxes {
        component: [1, 0, 2],
        reversed: [false, false, true],
    };

    /// East, north, up of a message. Component by component: a product would spread a NaN.
    pub(crate) fn to_enu(self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|i, _| self.sign(i) * v[self.component[i]])
    }

    /// Covariance in east, north, up of a message's.
    pub(crate) fn covariance_to_enu(self, p: &Matrix3<f64>) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| {
            self.sign(i) * self.sign(j) * p[(self.component[i], self.component[j])]
        })
    }

    /// The axes of messages that, read with `self`, come out turned: `turned` says where what is taken for east, north and up
    /// really points (index of the axis and whether reversed).
    pub(crate) fn turned(self, turned: [(usize, bool); 3]) -> Self {
        let mut axes = self;
        for (i, (axis, reversed)) in turned.into_iter().enumerate() {
            axes.component[axis] = self.component[i];
            axes.reversed[axis] = self.reversed[i] != reversed;
        }
        axes
    }

    fn sign(self, axis: usize) -> f64 {
        if self.reversed[axis] { -1.0 } else { 1.0 }
    }
}

impl FromStr for VelocityAxes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?}: where x, y and z point, in three letters of e or w, n or s, u or d, such as enu or ned"
            )
        };
        let letters: Vec<char> = text.to_ascii_lowercase().chars().collect();
        if letters.len() != 3 {
            return Err(wrong());
        }
        let mut axes = VelocityAxes::default();
        for (i, pair) in LETTERS.iter().enumerate() {
            let at = letters
                .iter()
                .position(|l| pair.contains(l))
                .ok_or_else(wrong)?;
            axes.component[i] = at;
            axes.reversed[i] = letters[at] == pair[1];
        }
        Ok(axes)
    }
}

impl fmt::Display for VelocityAxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for component in 0..3 {
            let letter = (0..3).find(|&i| self.component[i] == component);
            let letter = letter.map(|i| LETTERS[i][usize::from(self.reversed[i])]);
            write!(f, "{}", letter.unwrap_or('?'))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_48_are_read_and_written() {
        let mut seen = std::collections::BTreeSet::new();
        for order in [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ] {
            for signs in 0..8_usize {
                let text: String = order.iter().map(|&i| LETTERS[i][signs >> i & 1]).collect();
                let axes: VelocityAxes = text.parse().unwrap();
                assert_eq!(axes.to_string(), text);
                seen.insert(text.clone());
                // A velocity of 1, 2, 3 m/s to the east, north and up, as such a message has it.
                let message = Vector3::from_iterator(order.iter().map(|&i| {
                    let sign = if signs >> i & 1 == 1 { -1.0 } else { 1.0 };
                    sign * (i as f64 + 1.0)
                }));
                assert_eq!(axes.to_enu(&message), Vector3::new(1.0, 2.0, 3.0), "{text}");
                let p = message * message.transpose();
                let enu = Vector3::new(1.0, 2.0, 3.0);
                assert_eq!(axes.covariance_to_enu(&p), enu * enu.transpose(), "{text}");
            }
        }
        assert_eq!(seen.len(), 48);
        for wrong in ["", "en", "enuu", "eeu", "xyz", "enn"] {
            assert!(wrong.parse::<VelocityAxes>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_comes_out_turned_is_put_right() {
        let enu = VelocityAxes::default();
        // Taken for east is north, for north east, for up down: the message is north, east, down.
        let ned = enu.turned([(1, false), (0, false), (2, true)]);
        assert_eq!(ned.to_string(), "ned");
        assert_eq!(
            ned.turned([(0, true), (1, true), (2, false)]).to_string(),
            "swd"
        );
    }
}
