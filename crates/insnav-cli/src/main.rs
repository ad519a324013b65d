//! The command `insnav`.

use std::process::ExitCode;

fn main() -> ExitCode {
    insnav_cli::main(std::env::args_os())
}
