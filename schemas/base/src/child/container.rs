//! Containers. A container does not descend from the client that runs it, so it is ended by its name.

use std::{
    fmt,
    process::{Command, Stdio},
    sync::mpsc,
    thread,
    time::Duration,
};

/// Time that a runtime may take to kill a container.
const LONGEST_KILL: Duration = Duration::from_secs(10);

/// A container that a program runs as the client of a runtime.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Container {
    /// `docker` or a program with the same commands.
    pub runtime: String,
    /// Name of the container.
    pub name: String,
}

impl fmt::Display for Container {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "container {}", self.name)
    }
}

impl Container {
    /// Kills it; returns false where it does not run.
    ///
    /// # Errors
    /// When the runtime cannot be started, refuses or takes longer than 10 s; the message names the container.
    pub(super) fn kill(&self) -> Result<bool, String> {
        let failed = |reason: &str| format!("{self} ({} kill: {reason})", self.runtime);
        let mut command = Command::new(&self.runtime);
        command
            .args(["kill", &self.name])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command
            .spawn()
            .map_err(|error| failed(&error.to_string()))?;
        let id = child.id();
        let (sender, receiver) = mpsc::channel();
        thread::spawn(move || {
            // The receiver may have stopped waiting.
            drop(sender.send(child.wait_with_output()));
        });
        match receiver.recv_timeout(LONGEST_KILL) {
            Ok(Ok(output)) if output.status.success() => Ok(true),
            Ok(Ok(output)) => {
                let said = String::from_utf8_lossy(&output.stderr);
                if has_ended(&said) {
                    return Ok(false);
                }
                let last = said.lines().map(str::trim).rfind(|line| !line.is_empty());
                Err(failed(last.unwrap_or("it says nothing")))
            }
            Ok(Err(error)) => Err(failed(&error.to_string())),
            Err(_) => {
                super::tree::kill_group(id);
                let seconds = LONGEST_KILL.as_secs();
                Err(failed(&format!("took longer than {seconds} s")))
            }
        }
    }
}

/// Returns true where a runtime reports that the container does not exist or does not run, in the words of Docker,
/// Podman and nerdctl.
fn has_ended(said: &str) -> bool {
    let said = said.to_lowercase();
    ["no such container", "not running", "can only kill running"]
        .iter()
        .any(|words| said.contains(words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_container_that_is_gone_is_told_from_one_that_cannot_be_killed() {
        for said in [
            "Error response from daemon: cannot kill container: a: No such container: a",
            "Error response from daemon: cannot kill container: a: container 0f is not running",
            "Error: no container with name or ID \"a\" found: no such container",
            "Error: can only kill running containers. 0f is in state exited: container state improper",
        ] {
            assert!(has_ended(said), "{said}");
        }
        for said in [
            "permission denied while trying to connect to the Docker daemon socket",
            "",
        ] {
            assert!(!has_ended(said), "{said}");
        }
    }
}
