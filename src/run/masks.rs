//! Dynamic masks, which the main job makes of every sequence before it is posed.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use omnilife_curate::{
    MaskProgram,
    masks::{
        self, MaskSource,
        operator::{self, OperatorSearch},
    },
};
use omnilife_reconstruct::{methods::Method, request::MethodRequest};
use omnilife_schemas::{
    layout::{DYNAMIC_MASKS_FOLDER, OPERATOR_FOLDER},
    progress::Progress,
    records::OperatorFinding,
};

use crate::cli::{MaskStepArgument, MaskStepArguments};

/// Origin of the masks of every sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum MaskStep {
    /// No masks.
    None,
    /// A folder of the user, for a job of one sequence.
    Given(PathBuf),
    /// Made of every sequence.
    Made(MaskSource),
}

impl MaskStep {
    /// Returns the requested step, or the one that a method needs by default. Reports a needed detector that is off,
    /// with the reason and the option that turns one on.
    pub(crate) fn of(
        arguments: &MaskStepArguments,
        method: &Method,
        request: &MethodRequest,
    ) -> (Self, Option<String>) {
        let made = |source| (Self::Made(source), None);
        if let Some(id) = &arguments.masks_method {
            return made(MaskSource::Method(id.clone()));
        }
        if let Some(command) = &arguments.masks_command {
            return made(MaskSource::Program(MaskProgram {
                command: command.clone(),
                time_limit: Some(Duration::from_secs(arguments.command_timeout)),
            }));
        }
        match &arguments.masks {
            MaskStepArgument::None => (Self::None, None),
            MaskStepArgument::Folder(folder) => (Self::Given(folder.clone()), None),
            MaskStepArgument::Auto if !method.uses_masks(request) => (Self::None, None),
            MaskStepArgument::Auto => match masks::default_method() {
                Some(method) => made(MaskSource::Method(method.id.to_owned())),
                None => (Self::None, Some(all_off(method.id))),
            },
        }
    }

    /// Returns the folder of masks that the user gave.
    pub(crate) fn given(&self) -> Option<&PathBuf> {
        match self {
            Self::Given(folder) => Some(folder),
            Self::None | Self::Made(_) => None,
        }
    }

    /// Makes the masks of a sequence; returns their folder. A failure of the detector or program is reported, and
    /// leaves the sequence without masks.
    pub(crate) fn make(&self, folder: &Path, id: &str, progress: &dyn Progress) -> Option<PathBuf> {
        let source = match self {
            Self::None => return None,
            Self::Given(folder) => return Some(folder.clone()),
            Self::Made(source) => source,
        };
        match masks::write_masks(folder, source, progress) {
            Ok(record) => {
                let reliability = record.reliability.map(|words| format!("; {words}"));
                progress.note(&format!(
                    "{id}: dynamic masks by {}{}",
                    record.method,
                    reliability.unwrap_or_default()
                ));
                Some(folder.join(DYNAMIC_MASKS_FOLDER))
            }
            Err(error) => {
                progress.note(&format!("{id}: goes on without masks: {error}"));
                None
            }
        }
    }
}

/// Looks for the operator and mounts in a sequence; returns their mask if it is found. Reports a sequence without one,
/// or one on which a person has to decide.
pub(crate) fn operator(folder: &Path, id: &str, progress: &dyn Progress) -> Option<PathBuf> {
    let record = match operator::write_operator(folder, OperatorSearch::default(), progress) {
        Ok(record) => record,
        Err(error) => {
            progress.note(&format!(
                "{id}: nothing of the operator is ignored: {error}"
            ));
            return None;
        }
    };
    let files = folder.join(OPERATOR_FOLDER);
    let mask = record.mask.map(|file| files.join(file));
    let image = record.image.map(|file| files.join(file));
    let to_look_at = match (&mask, &image) {
        (Some(mask), Some(image)) => {
            let (mask, image) = (mask.display(), image.display());
            match record.finding {
                OperatorFinding::Doubtful => {
                    format!("; look at {image}: if it is carried, --ignore-mask {mask} ignores it")
                }
                _ => format!("; ignored, {image} shows it"),
            }
        }
        _ => String::new(),
    };
    progress.note(&format!("{id}: operator: {}{to_look_at}", record.reason));
    mask.filter(|_| record.finding == OperatorFinding::Found)
}

/// Returns the message on a method that trains without masks, because no detector reaches its bar.
fn all_off(method: &str) -> String {
    format!(
        "no dynamic masks are made for {method}: no detector reaches its bar; --masks-method NAME \
         turns one on, --masks-command takes a network ({})",
        masks::scores_in_words()
    )
}

#[cfg(test)]
mod tests {
    use omnilife_reconstruct::methods;

    use super::*;

    fn arguments(masks: MaskStepArgument) -> MaskStepArguments {
        MaskStepArguments {
            masks,
            masks_method: None,
            masks_command: None,
            operator: false,
            command_timeout: 60,
        }
    }

    fn step(
        arguments: &MaskStepArguments,
        method: &str,
        without: &[&str],
    ) -> (MaskStep, Option<String>) {
        let method = methods::find(method).expect("a method");
        let request = MethodRequest {
            without: without.iter().map(|&name| name.to_owned()).collect(),
            ..MethodRequest::new(1, 0)
        };
        MaskStep::of(arguments, method, &request)
    }

    #[test]
    fn a_method_that_learns_from_masks_gets_them_of_a_reliable_detector_alone() {
        let auto = arguments(MaskStepArgument::Auto);
        let (found, line) = step(&auto, "omni4dgs", &[]);
        match masks::default_method() {
            Some(detector) => {
                let source = MaskSource::Method(detector.id.to_owned());
                assert_eq!((found, line), (MaskStep::Made(source), None));
            }
            None => {
                assert_eq!(found, MaskStep::None);
                let line = line.expect("a line");
                assert!(
                    line.contains("--masks-method") && !line.contains('\n'),
                    "{line}"
                );
            }
        }
        assert_eq!(step(&auto, "odgs", &[]), (MaskStep::None, None));
        let fed = ["dynamic-mask", "velocity-regularization", "mask-seeds"];
        assert_eq!(step(&auto, "omni4dgs", &fed), (MaskStep::None, None));
    }

    #[test]
    fn what_is_asked_for_is_done_whatever_the_method() {
        let named = MaskStepArguments {
            masks_method: Some("residual".to_owned()),
            ..arguments(MaskStepArgument::Auto)
        };
        let made = MaskStep::Made(MaskSource::Method("residual".to_owned()));
        assert_eq!(step(&named, "odgs", &[]), (made, None));
        let program = MaskStepArguments {
            masks_command: "net {frames} {out}".parse().ok(),
            ..arguments(MaskStepArgument::Auto)
        };
        let (found, _) = step(&program, "odgs", &[]);
        assert!(matches!(found, MaskStep::Made(MaskSource::Program(_))));
        let none = arguments(MaskStepArgument::None);
        assert_eq!(step(&none, "omni4dgs", &[]), (MaskStep::None, None));
        let folder = arguments(MaskStepArgument::Folder("masks".into()));
        let (found, _) = step(&folder, "odgs", &[]);
        assert_eq!(found.given(), Some(&PathBuf::from("masks")));
    }
}
