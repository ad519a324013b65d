//! The main job on real recordings: every bar is on what was kept from the filter, or on what it never saw.
//!
//! Needs the recordings in `$INSNAV_DATA` or `../shared/data`; says SKIPPED without them. Settings are those of the
//! receivers and units, each with its reason beside it; everything else is what `run` chooses by itself.

mod noise_adapted;
mod orientation;
mod outages;
mod recording;
mod robot_heading;
mod slow_turn;
mod stops_found;
mod stops_heading;
mod stops_withheld;
