//! Shell completions and man pages, generated from the command line of a program.

use std::ffi::{OsStr, OsString};

use clap::{Arg, ArgAction, Command, ValueEnum, value_parser};
use clap_complete::Shell;

use crate::Result;

/// Adds the options `--completions` and `--man` to a command.
pub(crate) fn with_options(command: Command) -> Command {
    let completions = Arg::new("completions")
        .long("completions")
        .value_name("SHELL")
        .value_parser(value_parser!(Shell))
        .help("Print completions for a shell");
    let man = Arg::new("man")
        .long("man")
        .action(ArgAction::SetTrue)
        .help("Print the man page");
    let alone = |arg: Arg| arg.exclusive(true).help_heading("Running");
    command.arg(alone(completions)).arg(alone(man))
}

/// The document that `arguments` ask for: `PROGRAM --completions SHELL`, `PROGRAM --man` or
/// `PROGRAM SUBCOMMAND --man`. `None` for other arguments.
///
/// # Errors
/// `Failed` if it cannot be generated.
pub(crate) fn asked(command: &Command, arguments: &[OsString]) -> Result<Option<Vec<u8>>> {
    let words: Vec<&str> = arguments
        .iter()
        .skip(1)
        .filter_map(|a| a.to_str())
        .collect();
    if words.len() + 1 != arguments.len() {
        return Ok(None);
    }
    let mut command = command.clone();
    let name = command.get_name().to_owned();
    let mut text = Vec::new();
    match words[..] {
        ["--completions", shell] => {
            let Ok(shell) = Shell::from_str(shell, false) else {
                return Ok(None);
            };
            clap_complete::generate(shell, &mut command, name, &mut text);
        }
        ["--man"] => clap_mangen::Man::new(command).render(&mut text)?,
        [subcommand, "--man"] => {
            command.build();
            let Some(found) = command.find_subcommand(OsStr::new(subcommand)) else {
                return Ok(None);
            };
            clap_mangen::Man::new(found.clone()).render(&mut text)?;
        }
        _ => return Ok(None),
    }
    Ok(Some(text))
}
