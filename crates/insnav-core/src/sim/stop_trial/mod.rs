//! Trials of what a filter makes of a stop: the experiment of \[Kozadaev17\] section 3, as data, with the truth beside it.
//!
//! A [`StopSetting`] and a seed give a [`StopTrial`]: samples, a start that is wrong by known amounts, and the truth.
//! [`StopTrial::run`] gives them to an ordinary navigator with the settings of a [`StopVariant`], and returns its
//! [`StopErrors`]. All variants of a seed see the same samples and the same start.
//!
//! ```
//! use insnav_core::sim::{StopFlags, StopSetting, StopVariant};
//! let setting = StopSetting { stop_s: 10.0, ..StopSetting::paper() };
//! let errors = setting.trial(1)?.run(StopVariant::Basic, StopFlags::Exact)?;
//! assert!(errors.ends[0].heading_error.to_degrees().abs() < 10.0);
//! # Ok::<(), insnav_core::error::Error>(())
//! ```

mod continuity;
mod errors;
mod record;
mod setting;
mod trial;
mod variant;

pub use continuity::{Leap, Turning};
pub use errors::{HeadingPoint, MeanSquares, StopEndErrors, StopErrors};
pub use record::StaticRecord;
pub use setting::StopSetting;
pub use trial::{StopFlags, StopTrial};
pub use variant::StopVariant;
