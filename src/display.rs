//! Graphics drivers on machines without a display.

use std::env;

/// Keeps Mesa from looking for a display on a machine without one.
///
/// Its layer that sorts adapters asks a display server, and each list of adapters would print `error: XDG_RUNTIME_DIR
/// is invalid`. Adapters are sorted here in any case.
pub(crate) fn keep_drivers_quiet() {
    let has_display = ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "DISPLAY"]
        .iter()
        .any(|name| env::var_os(name).is_some());
    if !has_display && env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: `main` calls this first, when no other thread reads the environment.
        unsafe { env::set_var("NODEVICE_SELECT", "1") };
    }
}
