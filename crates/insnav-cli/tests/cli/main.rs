//! The command as a user meets it: arguments in, exit code and both streams out.

mod adapted_noise;
mod align;
mod compare;
mod convert;
mod demo;
mod errors;
mod findings;
mod fixture;
mod formats;
mod info;
mod noise;
mod orientation;
mod outputs;
mod parts;
mod real_data;
mod recover;
mod reproduce;
mod run;
mod settings_table;
mod several;
mod simulate;
mod stationary;
mod streams;
mod without_gnss;
