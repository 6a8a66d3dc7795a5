//! Third-party libraries that panic on damaged files.

use std::{
    cell::Cell,
    panic::{self, AssertUnwindSafe},
};

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs code that may panic on the content of a file. A panic on this thread becomes an error of the file, in the
/// library's words, and is not reported as a bug of the program.
///
/// # Errors
/// The message of the panic.
pub fn guarded<T>(read: impl FnOnce() -> T) -> Result<T, String> {
    let before = GUARDED.replace(true);
    // Only the values of the file can be half-made, and they are dropped.
    let outcome = panic::catch_unwind(AssertUnwindSafe(read));
    GUARDED.set(before);
    outcome.map_err(|payload| {
        let owned = payload.downcast_ref::<String>().map(String::as_str);
        let said = owned.or_else(|| payload.downcast_ref::<&str>().copied());
        said.unwrap_or("the reason is not told").to_owned()
    })
}

/// Returns whether this thread runs such code; a panic there is not reported.
pub fn is_guarded() -> bool {
    GUARDED.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_its_words() {
        let default = panic::take_hook();
        panic::set_hook(Box::new(|_| assert!(is_guarded())));
        let found = guarded(|| -> u8 { panic!("thrift {}", 1) });
        panic::set_hook(default);
        assert_eq!(found, Err("thrift 1".to_owned()));
        assert_eq!((guarded(|| 2), is_guarded()), (Ok(2), false));
    }
}
