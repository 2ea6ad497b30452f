//! The command line: options that every program takes, and parsers for their values.

use std::error::Error;
use std::ffi::OsString;
use std::fmt;
use std::io::Write;
use std::str::FromStr;

use clap::error::{ContextKind, ContextValue};
use clap::{ArgMatches, Args, Command, CommandFactory, FromArgMatches};

use deepshadow::Limits;

use crate::console::Console;
use crate::output::{Output, printed};
use crate::{Failure, Result, documents};

/// Most threads on a machine with fewer cores: idle threads cost time too, and 1024 of them on two
/// cores take three times the work of two.
const MOST_THREADS: usize = 256;

/// Options that every program takes.
#[derive(Clone, Copy, Debug, Default, Args)]
#[command(next_help_heading = "Running")]
pub struct Running {
    /// Use N threads; at most 256, or one per core if there are more [default: one per core]
    #[arg(
        short = 'j',
        long,
        value_name = "N",
        value_parser = |n: &str| number(n, |n: &usize| *n > 0, "a whole number above 0")
    )]
    pub threads: Option<usize>,
    /// Use at most MIB mebibytes of memory for the contents of files [default: 1024]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..))]
    pub memory: Option<u32>,
    /// Print no progress and no notes, only results and errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Also print details of the work on standard error
    #[arg(short, long)]
    pub verbose: bool,
}

impl Running {
    /// Returns the memory that each of `files` files may cause.
    pub fn limits(&self, files: usize) -> Limits {
        let limits = Limits::default();
        let all = self.memory.map_or(limits.memory, |m| u64::from(m) << 20);
        limits.memory(all / files.max(1) as u64)
    }

    /// Prepares for signals, starts the thread pool, and returns the console of the program called
    /// `program`.
    ///
    /// # Errors
    /// `Failed` if the threads cannot be started.
    pub fn start(&self, program: &'static str) -> Result<Console> {
        #[cfg(unix)]
        crate::signals::end_cleanly()?;
        let console = Console::new(program, self.quiet, self.verbose);
        if let Some(asked) = self.threads {
            let cores = std::thread::available_parallelism().map_or(1, usize::from);
            let threads = asked.min(MOST_THREADS.max(cores));
            if threads < asked {
                let line = format_args!("--threads {asked}: uses {threads} threads, the most");
                console.note(line);
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build_global()
                .map_err(|e| Failure::Failed(format!("cannot start {threads} threads: {e}")))?;
        }
        Ok(console)
    }
}

/// Parses the arguments of the process. `--help` and `--version` end the process.
///
/// # Errors
/// `Usage`, in one line, for wrong arguments.
pub fn parse<A: CommandFactory + FromArgMatches>() -> Result<A> {
    matches(A::command(), std::env::args_os()).and_then(|m| from_matches(&m))
}

/// Matches `arguments` with `command`; the first argument is the program. `--help`, `--version`,
/// `--completions` and `--man` end the process.
///
/// # Errors
/// `Usage`, in one line, for wrong arguments; `Failed` if the help cannot be printed.
pub fn matches(
    command: Command,
    arguments: impl IntoIterator<Item = OsString>,
) -> Result<ArgMatches> {
    let command = documents::with_options(command);
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    if let Some(text) = documents::asked(&command, &arguments)? {
        let mut out = Output::standard();
        out.text(&String::from_utf8_lossy(&text));
        out.flush()?;
        std::process::exit(0);
    }
    command.try_get_matches_from(arguments).map_err(|e| {
        if e.use_stderr() {
            return Failure::Usage(one_line(&e));
        }
        match printed(e.print().and_then(|()| std::io::stdout().flush())) {
            Ok(()) => std::process::exit(0),
            Err(failure) => failure,
        }
    })
}

/// Converts the matches of a command to its arguments.
///
/// # Errors
/// `Usage`, in one line.
pub fn from_matches<A: FromArgMatches>(matches: &ArgMatches) -> Result<A> {
    A::from_arg_matches(matches).map_err(|e| Failure::Usage(one_line(&e)))
}

/// Adds `[default: TEXT]` to the help of each listed option, by its id.
pub fn with_defaults(command: Command, defaults: &[(&'static str, &str)]) -> Command {
    defaults.iter().fold(command, |command, (id, default)| {
        command.mut_arg(*id, |arg| {
            let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
            arg.help(format!("{help} [default: {default}]"))
        })
    })
}

/// Formats an error of clap in one line. A wrong value becomes `--option VALUE: REASON`, the shape
/// of all errors in one option.
fn one_line(e: &clap::Error) -> String {
    let context = |kind| match e.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let option = context(ContextKind::InvalidArg).and_then(|arg| arg.split(' ').next());
    if let (Some(option), Some(value)) = (option, context(ContextKind::InvalidValue)) {
        if let Some(reason) = e.source() {
            return format!("{option} {value}: {}", plain(reason.to_string()));
        }
        if let Some(ContextValue::Strings(names)) = e.get(ContextKind::ValidValue) {
            let guess = match e.get(ContextKind::SuggestedValue) {
                Some(ContextValue::String(guess)) => format!("; did you mean {guess}?"),
                _ => String::new(),
            };
            return format!("{option} {value}: not one of {}{guess}", names.join(", "));
        }
    }
    let text = e.render().to_string();
    let line = text
        .lines()
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"))
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with("tip: to pass"))
        .collect::<Vec<_>>()
        .join(" ")
        .replace(" tip: ", "; ");
    plain(line.strip_prefix("error: ").unwrap_or(&line).to_owned())
}

/// Replaces the words of the standard library and of clap by those of a user.
fn plain(line: String) -> String {
    const PLAIN: [(&str, &str); 7] = [
        (
            "the following required arguments were not provided:",
            "missing arguments:",
        ),
        ("invalid digit found in string", "not a whole number"),
        ("invalid float literal", "not a number"),
        (
            "cannot parse integer from empty string",
            "not a whole number",
        ),
        ("cannot parse float from empty string", "not a number"),
        ("target type", "this option"),
        ("the argument '", "'"),
    ];
    PLAIN
        .iter()
        .fold(line, |line, (from, to)| line.replace(from, to))
}

/// Parses a number for which `fits` holds; `what` says in the error which numbers do.
///
/// # Errors
/// The text is another number, or none.
pub fn number<T: FromStr>(
    text: &str,
    fits: impl FnOnce(&T) -> bool,
    what: &str,
) -> std::result::Result<T, String> {
    let number = text.trim().parse().ok().filter(fits);
    number.ok_or_else(|| format!("not {what}"))
}

/// Parses a number from 0 to 1.
///
/// # Errors
/// The text is another number, or none.
pub fn fraction(text: &str) -> std::result::Result<f64, String> {
    number(text, |v| (0.0..=1.0).contains(v), "a number from 0 to 1")
}

/// Parses exactly `N` numbers, separated by `separator`.
pub fn numbers<const N: usize, T: FromStr>(text: &str, separator: char) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text
        .split(separator)
        .map(|n| n.trim().parse().ok())
        .collect();
    numbers?.try_into().ok()
}

/// The size of a map or a picture in pixels, parsed from `512` (a square) or `640x480`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resolution {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

impl Resolution {
    /// The longest side of any map.
    const LONGEST: u32 = 1 << 20;
}

impl FromStr for Resolution {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let one = numbers(text, 'x').map(|[side]| [side; 2]);
        let [width, height] = one
            .or_else(|| numbers(text, 'x'))
            .ok_or("not a size in pixels: write a side N, or WxH")?;
        if ![width, height]
            .iter()
            .all(|side| (1..=Self::LONGEST).contains(side))
        {
            return Err(format!("a side must be 1 to {} pixels long", Self::LONGEST));
        }
        Ok(Resolution { width, height })
    }
}

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}

/// A rectangle of pixels: x, y, width, height.
pub type Region = [u32; 4];

/// Parses a rectangle `X,Y,W,H`.
///
/// # Errors
/// The text has another form, or the rectangle is empty.
pub fn region(text: &str) -> std::result::Result<Region, String> {
    match numbers(text, ',') {
        Some([_, _, 0, _] | [_, _, _, 0]) => Err("the rectangle is empty".into()),
        Some(region) => Ok(region),
        None => Err("not a rectangle X,Y,W,H in pixels".into()),
    }
}

/// Parses three numbers `X,Y,Z`.
///
/// # Errors
/// The text has another form.
pub fn three(text: &str) -> std::result::Result<[f64; 3], String> {
    numbers(text, ',').ok_or_else(|| "not three numbers X,Y,Z".into())
}

/// Parses the width of a footprint in pixels.
///
/// # Errors
/// The text is not a finite number of at least 0.
pub fn width(text: &str) -> std::result::Result<f32, String> {
    let fits = |w: &f32| (0.0..f32::INFINITY).contains(w);
    number(text, fits, "a number of pixels, at least 0")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_finite_and_not_negative() {
        assert_eq!(width("2.5"), Ok(2.5));
        assert_eq!(width("0"), Ok(0.0));
        for wrong in ["-1", "nan", "inf", "1e39", "", "two"] {
            assert!(width(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_resolution_is_one_side_or_two() {
        let parsed = |text: &str| text.parse::<Resolution>().map(|r| (r.width, r.height));
        assert_eq!(parsed("512"), Ok((512, 512)));
        assert_eq!(parsed("640x480"), Ok((640, 480)));
        for wrong in [
            "", "0", "0x5", "5x", "64,64", "1x2x3", "-1", "1048577", "1.5",
        ] {
            assert!(parsed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_region_is_not_empty() {
        assert_eq!(region("1,2, 3,4"), Ok([1, 2, 3, 4]));
        for wrong in ["", "1,2,3", "1,2,0,4", "1,2,3,0", "1,2,3,4,5", "-1,2,3,4"] {
            assert!(region(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn wrong_arguments_are_reported_in_one_line() {
        let command = || Running::augment_args(Command::new("dsm-test"));
        let matches = |rest: &[&str]| {
            let all = ["dsm-test"].iter().chain(rest).map(OsString::from);
            super::matches(command(), all).map(|m| from_matches::<Running>(&m).unwrap())
        };
        assert_eq!(matches(&["-j", "3"]).unwrap().threads, Some(3));
        for wrong in [&["-j", "0"][..], &["-qv"], &["--nonsense"], &["-j", "two"]] {
            let failure = matches(wrong).unwrap_err();
            assert!(
                matches!(&failure, Failure::Usage(line) if !line.contains('\n')),
                "{failure}"
            );
        }
        let line = |wrong: &[&str]| matches(wrong).unwrap_err().to_string();
        assert_eq!(
            line(&["--nonsense"]),
            "unexpected argument '--nonsense' found (try --help)"
        );
        assert_eq!(
            line(&["-j", "0"]),
            "--threads 0: not a whole number above 0 (try --help)"
        );
    }
}
