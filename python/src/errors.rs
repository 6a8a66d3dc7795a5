//! Conversion of errors to Python's exceptions, which are classes of `omnilife/errors.py`.

use std::any::Any;

use omnilife_schemas::{Classified, ErrorKind};
use pyo3::{
    exceptions::PySystemError,
    prelude::*,
    types::{PyModule, PyType},
};

/// Error in one line, with the party that has to act.
#[derive(Debug)]
pub(crate) struct Failure {
    class: &'static str,
    message: String,
}

impl Failure {
    /// Makes the error of inputs that contradict each other.
    pub(crate) fn of_input(message: impl Into<String>) -> Self {
        Self {
            class: "InputError",
            message: message.into(),
        }
    }

    /// Makes the error of a panic, which is a bug of the program.
    pub(crate) fn of_panic(payload: &(dyn Any + Send)) -> Self {
        let owned = payload.downcast_ref::<String>().map(String::as_str);
        let said = owned.or_else(|| payload.downcast_ref::<&str>().copied());
        let reason = said.unwrap_or("the reason is not told");
        Self::of_machine(format!("failed by a mistake of omnilife: {reason}"))
    }

    fn of_machine(message: String) -> Self {
        Self {
            class: "MachineError",
            message,
        }
    }
}

impl<E: Classified> From<E> for Failure {
    fn from(error: E) -> Self {
        let words = error.to_string();
        let message = words.split_whitespace().collect::<Vec<_>>().join(" ");
        match error.error_kind() {
            ErrorKind::User => Self::of_input(message),
            ErrorKind::Internal => Self::of_machine(message),
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        Python::attach(|py| {
            let class = PyModule::import(py, "omnilife.errors")
                .and_then(|module| module.getattr(failure.class))
                .and_then(|class| Ok(class.cast_into::<PyType>()?));
            match class {
                Ok(class) => Self::from_type(class, failure.message),
                Err(error) => PySystemError::new_err(format!("{error}: {}", failure.message)),
            }
        })
    }
}
