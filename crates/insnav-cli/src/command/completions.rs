//! `insnav completions` and `insnav man`: what the shell and the reader of manuals need, made from the arguments themselves.

use crate::args::Cli;
use crate::failure::Failure;
use crate::output::Output;
use clap::{Args, CommandFactory};
use clap_complete::Shell;

/// Print completions for a shell
///
/// For example: insnav completions bash > ~/.local/share/bash-completion/completions/insnav
#[derive(Args, Debug)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum, value_name = "SHELL")]
    shell: Shell,
}

impl Completions {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "insnav", &mut script);
        let script = String::from_utf8_lossy(&script);
        let json = serde_json::json!({ "shell": self.shell.to_string(), "script": script });
        output.result(&json, || script.to_string());
        Ok(0)
    }
}

/// Print the manual, or that of one verb, as a man page
///
/// For example: insnav man run | man -l -
#[derive(Args, Debug)]
pub(crate) struct Man {
    /// The verb [default: the command as a whole]
    #[arg(value_name = "VERB")]
    verb: Option<String>,
}

impl Man {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let mut command = Cli::command();
        // Global flags and full names go down to the verbs.
        command.build();
        let of = match &self.verb {
            None => command,
            Some(name) => {
                let verbs = command.get_subcommands().map(|c| c.get_name().to_owned());
                let known: Vec<String> = verbs.collect();
                let found = command.find_subcommand(name).ok_or_else(|| {
                    Failure::usage(
                        format!("{name}: there is no such verb"),
                        format!("known: {}", known.join(", ")),
                    )
                })?;
                found.clone().display_name(format!("insnav-{name}"))
            }
        };
        let mut page = Vec::new();
        clap_mangen::Man::new(of)
            .render(&mut page)
            .map_err(|e| Failure::new("internal", format!("man: {e}"), "tell it to the authors"))?;
        let page = String::from_utf8_lossy(&page);
        output.result(&serde_json::json!({ "page": page }), || page.to_string());
        Ok(0)
    }
}
