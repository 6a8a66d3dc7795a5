//! Amounts of memory as arguments.

/// Bytes of a number of GiB.
pub(super) fn gibibytes(text: &str) -> Result<u64, String> {
    text.parse()
        .ok()
        .filter(|gibibytes: &f64| *gibibytes > 0.0 && *gibibytes < 1e9)
        .map(|gibibytes| (gibibytes * f64::from(1 << 30)) as u64)
        .ok_or_else(|| "must be a positive number of GiB".to_owned())
}
