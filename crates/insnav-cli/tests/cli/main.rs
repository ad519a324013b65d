//! The command as a user meets it: arguments in, exit code and both streams out.

mod compare;
mod convert;
mod demo;
mod errors;
mod fixture;
mod info;
mod outputs;
mod parts;
mod real_data;
mod run;
mod several;
mod simulate;
mod streams;
