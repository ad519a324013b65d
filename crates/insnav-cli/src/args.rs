//! The arguments as a whole: one verb, one format.

use crate::command::{
    Ahrs, Align, Compare, Completions, Convert, Demo, Info, Man, Noise, Reproduce, Run, Simulate,
};
use crate::failure::Failure;
use crate::output::{Format, Output};
use clap::{Parser, Subcommand};

/// INS/GNSS navigation of recorded logs, with honest uncertainty.
///
/// Exit codes: 0 done, 1 failed, 2 wrong usage (a flag, its value, or a combination), 3 done, but with warnings about the
/// data under --strict; 130 and 143 when interrupted, which leaves no half-written file behind.
#[derive(Debug, Parser)]
#[command(name = "insnav", version, max_term_width = 120)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) verb: Verb,

    /// Text for people, or one JSON object on standard output
    #[arg(
        long,
        global = true,
        value_enum,
        default_value_t,
        value_name = "FORMAT"
    )]
    pub(crate) format: Format,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    Run(Run),
    Info(Info),
    Align(Align),
    Ahrs(Ahrs),
    Noise(Noise),
    Compare(Compare),
    Convert(Convert),
    Demo(Demo),
    Simulate(Simulate),
    Reproduce(Reproduce),
    Completions(Completions),
    Man(Man),
}

impl Verb {
    /// Do the job; the number is the exit code of a job done.
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        match self {
            Verb::Run(verb) => verb.run(output),
            Verb::Info(verb) => verb.run(output),
            Verb::Align(verb) => verb.run(output),
            Verb::Ahrs(verb) => verb.run(output),
            Verb::Noise(verb) => verb.run(output),
            Verb::Compare(verb) => verb.run(output),
            Verb::Convert(verb) => verb.run(output),
            Verb::Demo(verb) => verb.run(output),
            Verb::Simulate(verb) => verb.run(output),
            Verb::Reproduce(verb) => verb.run(output),
            Verb::Completions(verb) => verb.run(output),
            Verb::Man(verb) => verb.run(output),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }
}
