//! Interface through which long work reports itself.
//!
//! Libraries call it and draw nothing; the binary decides between bars, plain lines and silence.

/// Receives the progress of one piece of work at a time.
pub trait Progress: Sync {
    /// Starts work named `label`; `total` is the number of its steps where that is known.
    fn begin(&self, label: &str, total: Option<u64>);
    /// Counts `steps` more steps as done.
    fn advance(&self, steps: u64);
    /// Shows a status next to the bar, such as the current loss.
    fn status(&self, text: &str);
    /// Ends the work that was started last.
    fn end(&self);
    /// Prints a line that the user should see in any case: a decision, a skipped stage.
    fn note(&self, line: &str);
    /// Returns whether the caller has given the work up. Work that asks ends soon, with an error that says so.
    fn is_interrupted(&self) -> bool {
        false
    }
}

/// Progress that reports nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, _: &str) {}
}
