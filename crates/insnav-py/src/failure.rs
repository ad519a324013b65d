//! Errors and warnings as Python sees them: a class by what is wrong, a code for programs, a message, a remedy for people, and what
//! the error is about as attributes.

use crate::remedy::{self, in_python};
use insnav_core::alignment::Refusal;
use insnav_core::error::Error as CoreError;
use insnav_core::noise;
use insnav_core::time::Time;
use insnav_log::{ConfigError, LogError, Problem, RunError, StateError, Warning};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;

/// The classes of `insnav._errors`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// What was given to a function.
    Argument,
    /// The settings.
    Config,
    /// A file.
    Log,
    /// No start, or no attitude from stops.
    Alignment,
    /// Data that cannot be navigated.
    Navigation,
    /// A quantity that the data do not tell: noise, a clock.
    Identification,
}

impl Class {
    fn name(self) -> &'static str {
        match self {
            Class::Argument => "ArgumentError",
            Class::Config => "ConfigError",
            Class::Log => "LogError",
            Class::Alignment => "AlignmentError",
            Class::Navigation => "NavigationError",
            Class::Identification => "IdentificationError",
        }
    }
}

/// What went wrong, before it becomes an `insnav.InsnavError`.
#[derive(Debug)]
pub(crate) struct Failure(Box<Told>);

#[derive(Debug)]
struct Told {
    problem: Problem,
    class: Class,
    /// Names and texts of attributes.
    attributes: Vec<(&'static str, String)>,
    /// On the log's clock.
    time: Option<Time>,
    /// From the zero of the data.
    time_s: Option<f64>,
    /// What Python raised by itself, which is passed on as it is.
    raised: Option<PyErr>,
}

impl Failure {
    /// Of an argument, until [`Failure::of`] says otherwise.
    pub(crate) fn new(
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Failure::told(Class::Argument, Problem::new(code, message, remedy))
    }

    /// An argument that is something else than it should be: the message says so.
    pub(crate) fn argument(
        code: &'static str,
        argument: &str,
        received: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (received, expected) = (received.into(), expected.into());
        let message = format!("{argument}: {received}, expected {expected}");
        Failure::new(code, message, remedy).about(argument, received, expected)
    }

    /// A word that is none of those that are known.
    pub(crate) fn unknown_word(argument: &str, given: &str, known: &str) -> Self {
        Failure::new(
            "bad_option",
            format!("{argument}: {given:?} is not known"),
            format!("one of {known}"),
        )
        .about(argument, format!("{given:?}"), format!("one of {known}"))
    }

    fn told(class: Class, problem: Problem) -> Self {
        Failure(Box::new(Told {
            problem,
            class,
            attributes: Vec::new(),
            time: None,
            time_s: None,
            raised: None,
        }))
    }

    /// From what Python raised while it looked at an argument: `told` if that is about the argument, else what was raised, such as an
    /// interruption.
    pub(crate) fn raised(py: Python<'_>, raised: PyErr, told: impl FnOnce(&PyErr) -> Self) -> Self {
        let about_it = raised.is_instance_of::<PyValueError>(py)
            || raised.is_instance_of::<PyTypeError>(py)
            || raised.is_instance_of::<PyOverflowError>(py);
        let mut failure = if about_it {
            return told(&raised);
        } else {
            Failure::new("raised", "", "")
        };
        failure.0.raised = Some(raised);
        failure
    }

    /// The same, of another class.
    pub(crate) fn of(mut self, class: Class) -> Self {
        self.0.class = class;
        self
    }

    /// Which argument, what it is and what it should be: for programs, the message stays as it is.
    pub(crate) fn about(
        self,
        argument: &str,
        received: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        self.with("argument", argument)
            .with("received", received)
            .with("expected", expected)
    }

    /// Which measurement, sensor or quantity.
    pub(crate) fn measured(self, measurement: &str) -> Self {
        self.with("measurement", measurement)
    }

    /// When, on the log's clock. [`Failure::counted_from`] says from when its seconds count.
    pub(crate) fn at(mut self, time: Time) -> Self {
        self.0.time = Some(time);
        self
    }

    /// When, in seconds from the zero of the data.
    pub(crate) fn at_s(mut self, time_s: f64) -> Self {
        self.0.time_s = Some(time_s);
        self
    }

    /// Seconds count from `zero`: that of the solution.
    pub(crate) fn counted_from(mut self, zero: Option<Time>) -> Self {
        if let (Some(time), Some(zero), None) = (self.0.time, zero, self.0.time_s) {
            self.0.time_s = Some(time.since(zero));
        }
        self
    }

    /// The same where arrays were given in place of a log: remedies do not speak of topics.
    pub(crate) fn of_arrays(mut self) -> Self {
        let remedy = &mut self.0.problem.remedy;
        *remedy = remedy::of_arrays(remedy);
        self
    }

    /// The first of several.
    pub(crate) fn with_others(mut self, others: usize) -> Self {
        let message = &mut self.0.problem.message;
        *message = format!("{message}, and {others} other samples that cannot be used");
        self
    }

    fn with(mut self, name: &'static str, text: impl Into<String>) -> Self {
        self.0.attributes.push((name, text.into()));
        self
    }

    fn path(self, path: &Path) -> Self {
        self.with("path", path.display().to_string())
    }

    /// The Python exception. Its class is written in Python, so that it can be pickled and subclassed like any other.
    pub(crate) fn into_py_err(mut self, py: Python<'_>) -> PyErr {
        if let Some(raised) = self.0.raised.take() {
            return raised;
        }
        let make = || {
            let Told {
                problem,
                class,
                attributes,
                time,
                time_s,
                ..
            } = *self.0;
            let about = PyDict::new(py);
            for (name, text) in attributes {
                about.set_item(name, text)?;
            }
            about.set_item("time_ns", time.map(|t| t.0))?;
            about.set_item("time_s", time_s)?;
            py.import("insnav._errors")?.getattr(class.name())?.call(
                (
                    problem.message,
                    problem.code.as_ref(),
                    in_python(&problem.remedy),
                ),
                Some(&about),
            )
        };
        match make() {
            Ok(exception) => PyErr::from_value(exception),
            Err(error) => error,
        }
    }
}

/// For `map_err`: what went wrong as Python's exception.
pub(crate) fn fail(py: Python<'_>) -> impl Fn(Failure) -> PyErr + Copy + '_ {
    move |e| e.into_py_err(py)
}

/// The same of what the core refuses; seconds count from `zero`.
pub(crate) fn refused(py: Python<'_>, zero: Time) -> impl Fn(CoreError) -> PyErr + Copy + '_ {
    move |e| Failure::from(e).counted_from(Some(zero)).into_py_err(py)
}

/// Tell the user by way of Python's own warnings, at the line that called.
pub(crate) fn warn(py: Python<'_>, warning: &Warning) -> PyResult<()> {
    let category = py.import("insnav._errors")?.getattr("InsnavWarning")?;
    let text = format!("{} ({})", warning.message, in_python(&warning.remedy));
    py.import("warnings")?
        .call_method1("warn", (text, category))?;
    Ok(())
}

/// The same where arrays were given in place of a log.
pub(crate) fn warn_of_arrays(py: Python<'_>, warning: &Warning) -> PyResult<()> {
    let told = Warning {
        remedy: remedy::of_arrays(&warning.remedy),
        ..warning.clone()
    };
    warn(py, &told)
}

impl From<LogError> for Failure {
    fn from(e: LogError) -> Self {
        type E = LogError;
        let about = |f: Failure| match &e {
            E::NoSuchFile { path }
            | E::Read { path, .. }
            | E::NotAnMcap { path, .. }
            | E::Truncated { path, .. }
            | E::Crc { path, .. }
            | E::Damaged { path, .. }
            | E::Compression { path, .. }
            | E::NoTopic { path, .. }
            | E::AmbiguousTopic { path, .. }
            | E::OutputExists { path }
            | E::OutputNotWritable { path, .. }
            | E::Write { path, .. }
            | E::Cell { path, .. }
            | E::MissingColumn { path, .. }
            | E::NoFixes { path, .. }
            | E::NoDate { path }
            | E::NotASolution { path, .. }
            | E::Unwritable { path, .. } => f.path(path),
            E::UnknownTopic { path, topic, .. }
            | E::WrongType { path, topic, .. }
            | E::NotUnderstood { path, topic } => f.path(path).with("topic", topic),
            E::NotMapped {
                path, topic, time, ..
            } => f.path(path).with("topic", &**topic).at(*time),
            E::Decode {
                path, topic, time, ..
            }
            | E::StampBackward {
                path, topic, time, ..
            } => f.path(path).with("topic", topic).at(*time),
            _ => f,
        };
        let empty = Failure::told(Class::Log, Problem::new("", "", ""));
        let mut failure = about(empty);
        failure.0.problem = e.into();
        failure
    }
}

impl From<ConfigError> for Failure {
    fn from(e: ConfigError) -> Self {
        let key = match &e {
            ConfigError::UnknownKey { key, .. } | ConfigError::Value { key, .. } => {
                Some(key.clone())
            }
            _ => None,
        };
        let failure = Failure::told(Class::Config, e.into());
        match key {
            Some(key) => failure.with("key", key),
            None => failure,
        }
    }
}

impl From<StateError> for Failure {
    fn from(e: StateError) -> Self {
        RunError::from(e).into()
    }
}

impl From<CoreError> for Failure {
    fn from(e: CoreError) -> Self {
        RunError::from(e).into()
    }
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        CoreError::from(refusal).into()
    }
}

impl From<RunError> for Failure {
    fn from(e: RunError) -> Self {
        let of = |class: Class| Failure::told(class, Problem::new("", "", ""));
        let mut failure = match &e {
            RunError::Log(_) | RunError::Config(_) => {
                return match e {
                    RunError::Log(e) => e.into(),
                    RunError::Config(e) => e.into(),
                    other => Failure::told(Class::Navigation, other.into()),
                };
            }
            RunError::State(_) => of(Class::Log),
            RunError::Navigator(e) => of_the_core(e),
            RunError::NoRest { .. } | RunError::NoLatitude | RunError::NoStops { .. } => {
                of(Class::Alignment)
            }
            RunError::Noise(refusal) => of(class_of_noise(refusal)),
            RunError::AllWithheld { .. } => of(Class::Argument).with("argument", "withhold"),
            RunError::NeedsGnss { option } => of(Class::Argument).with("argument", *option),
            RunError::StartOutside { time, .. } => {
                of(Class::Argument).with("argument", "start").at_s(*time)
            }
            RunError::PartOutside { from, .. } => {
                of(Class::Argument).with("argument", "part_s").at_s(*from)
            }
            RunError::WindowTooLong { .. } => of(Class::Config).with("key", "stationary.window_s"),
            _ => of(Class::Navigation),
        };
        failure.0.problem = e.into();
        failure
    }
}

/// Class and attributes of an error of the core.
fn of_the_core(e: &CoreError) -> Failure {
    let of = |class: Class| Failure::told(class, Problem::new("", "", ""));
    match *e {
        CoreError::ImuBackward { time, .. } => of(Class::Navigation).measured("imu").at(time),
        CoreError::NotFinite { what, time } => of(Class::Navigation).measured(what).at(time),
        CoreError::NotPositiveDefinite {
            measurement, time, ..
        } => of(Class::Navigation).measured(measurement).at(time),
        CoreError::Config { key, .. } => of(Class::Config).with("key", key),
        CoreError::NotStarted { .. } => of(Class::Alignment),
        CoreError::NotObservable { what, .. } => of(Class::Identification).measured(what),
        CoreError::Alignment(refusal) => {
            let failure = of(Class::Alignment);
            match refusal.time_s() {
                Some(time_s) => failure.at_s(time_s),
                None => failure,
            }
        }
        _ => of(Class::Navigation),
    }
}

/// What does not fit together is the caller's, what does not tell is the data's.
pub(crate) fn class_of_noise(refusal: &noise::Refusal) -> Class {
    match refusal {
        noise::Refusal::Shape { .. }
        | noise::Refusal::NotFinite { .. }
        | noise::Refusal::Setting { .. } => Class::Argument,
        noise::Refusal::Axis { why, .. } => class_of_noise(why),
        _ => Class::Identification,
    }
}
