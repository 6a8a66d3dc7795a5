//! All reconstruction methods, found by name: one line each in [`METHODS`].

use std::{collections::BTreeSet, path::Path};

use omnilife_atlas as neural_atlas;
use omnilife_methods::{
    deformable, feed_forward, object_graph, odgs, odgs_published, omni4dgs, omni4dgs_plus, panogs,
    periodic,
};
use omnilife_schemas::{layout::RUN_FILE, names, records::RunRecord, store};
use omnilife_training::{error::ReconstructError, method::Method, models::ModelFormat};

/// All methods.
pub const METHODS: &[Method] = &[
    odgs::METHOD,
    odgs_published::METHOD,
    deformable::METHOD,
    periodic::METHOD,
    omni4dgs::METHOD,
    omni4dgs_plus::METHOD,
    panogs::METHOD,
    neural_atlas::METHOD,
    object_graph::METHOD,
    feed_forward::sweep::METHOD,
    feed_forward::infinity::METHOD,
    feed_forward::cross_fade::METHOD,
    feed_forward::nearest::METHOD,
];

/// Returns the method of this name.
///
/// # Errors
/// When no method has this name; the error lists all names.
pub fn find(id: &str) -> Result<&'static Method, ReconstructError> {
    Ok(names::find("method", id, METHODS, |method| method.id)?)
}

/// An open run: its record, and the kind of model in its folder.
#[derive(Debug)]
pub struct OpenedRun {
    /// The run's record.
    pub record: RunRecord,
    /// Kind of its model.
    pub model: &'static ModelFormat,
}

/// Reads a run's record and finds the model format of its method.
///
/// # Errors
/// When the record is missing, its method is unknown, or the method leaves no model.
pub fn open_run(folder: &Path) -> Result<OpenedRun, ReconstructError> {
    let path = folder.join(RUN_FILE);
    let record: RunRecord = store::read_record(&path)?;
    let method =
        find(&record.method).map_err(|error| ReconstructError::scene(&path, error.to_string()))?;
    let Some(model) = method.model() else {
        let reason = format!("is a run of {}, which leaves no model", method.id);
        return Err(ReconstructError::scene(folder, reason));
    };
    Ok(OpenedRun { record, model })
}

/// Returns the files of the models of all methods, each once.
pub fn model_files() -> BTreeSet<&'static str> {
    let models = METHODS.iter().filter_map(Method::model);
    models.flat_map(|model| model.files).copied().collect()
}

#[cfg(test)]
mod tests {
    use omnilife_training::{
        components::{COMPONENTS, aids},
        models::Export,
        request::{BackendChoice, MethodRequest},
        scene::CameraExtent,
    };

    use super::*;

    #[test]
    fn methods_are_unique_and_described() {
        for (index, method) in METHODS.iter().enumerate() {
            assert!(METHODS[..index].iter().all(|other| other.id != method.id));
            assert!(!method.title.is_empty() && !method.source.is_empty());
            assert!(method.description.len() > 40, "{}", method.id);
            assert!(method.options.iter().all(|option| option.doc.len() > 20));
            assert_eq!(find(method.id).map(|found| found.id).ok(), Some(method.id));
        }
        let shared = |name: &&str| {
            aids::is_aid(name) || COMPONENTS.iter().any(|component| component.id == *name)
        };
        for method in METHODS {
            let (own, optional) = (method.components, method.optional_components);
            // What is a method's own is explained where it is listed.
            let is_explained = |name: &&str| shared(name) || method.description.contains(*name);
            assert!(optional.iter().all(is_explained), "{}", method.id);
            assert!(optional.iter().all(|name| !own.contains(name)));
        }
        let message = find("nerf").map(|_| ()).expect_err("unknown").to_string();
        assert!(
            message.contains("nerf") && message.contains("odgs"),
            "{message}"
        );
    }

    #[test]
    fn kinds_of_model_are_told_apart_by_their_files() {
        let set = |model: &ModelFormat| model.files.iter().copied().collect::<BTreeSet<_>>();
        let uses = |model: &ModelFormat| {
            let edit = model.edit.is_some();
            (edit, model.has_splats(), model.textures().is_some())
        };
        let models = METHODS.iter().filter_map(Method::model);
        let models: Vec<&ModelFormat> = models.collect();
        for model in &models {
            let files = set(model);
            assert_eq!(files.len(), model.files.len(), "{files:?}");
            assert!(files.is_subset(&model_files()), "{files:?}");
            let is_name = |file: &&str| !file.contains(['/', '\\']) && *file != RUN_FILE;
            assert!(!files.is_empty() && files.iter().all(is_name), "{files:?}");
            let is_splats = |export: &&Export| matches!(export, Export::Splats);
            let splats = model.exports.iter().filter(is_splats).count();
            assert!(splats <= 1 && model.exports.len() - splats <= 1);
            for other in &models {
                if set(other) == files {
                    assert_eq!(uses(model), uses(other), "{files:?}");
                } else {
                    assert!(!files.is_subset(&set(other)), "{files:?} {:?}", other.files);
                }
            }
        }
    }

    #[test]
    fn methods_of_one_class_have_the_same_aids_by_default() {
        // Aids for Gaussians of any kind, and those for Gaussians that appear and vanish.
        let of_all = ["denser-points", "short-schedule"];
        let of_lives = ["mask-seeds", "static-table"];
        for method in METHODS {
            let aids: BTreeSet<&str> = method.supported().aids().collect();
            if aids.is_empty() {
                continue;
            }
            let has = |aid: &str| method.components.contains(&aid);
            let begins_with_points = aids.contains("denser-points");
            let lives = has("temporal-opacity");
            assert!(has("short-schedule"), "{}", method.id);
            assert!(
                !begins_with_points || of_all.iter().all(|aid| has(aid)),
                "{}",
                method.id
            );
            assert!(
                of_lives.iter().all(|aid| has(aid) == lives),
                "{}",
                method.id
            );
            if begins_with_points {
                let missing = aids::ON_REQUEST.iter().find(|aid| !aids.contains(**aid));
                assert_eq!(missing, None, "{}", method.id);
            }
        }
        let with_aids = METHODS.iter().filter(|m| m.supported().aids().count() > 0);
        let ids: Vec<&str> = with_aids.map(|method| method.id).collect();
        assert_eq!(
            ids,
            [
                "odgs",
                "deformable",
                "periodic",
                "omni4dgs",
                "omni4dgs-plus",
                "panogs",
                "object-graph"
            ]
        );
    }

    #[test]
    fn only_published_code_lets_the_farthest_camera_decide() {
        for method in METHODS {
            let is_published = method.id == odgs_published::METHOD.id;
            let is_farthest = method.camera_extent() == CameraExtent::Farthest;
            assert_eq!(is_farthest, is_published, "{}", method.id);
        }
    }

    #[test]
    fn backends_that_a_method_lacks_are_refused() {
        for method in METHODS {
            assert_eq!(method.backends[0], BackendChoice::Cpu, "{}", method.id);
            let request = MethodRequest::new(1, 0);
            let refused = method.check(&request, BackendChoice::Gpu).err();
            let message = refused.map(|error| error.to_string()).unwrap_or_default();
            let runs = method.backends.contains(&BackendChoice::Gpu);
            assert_eq!(message.contains("no GPU kernels"), !runs, "{message}");
        }
    }

    #[test]
    fn components_that_a_method_lacks_and_contradictions_are_refused() {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let refusal = |method: &Method, with: &[&str], without: &[&str]| {
            let request = MethodRequest {
                with: owned(with),
                without: owned(without),
                ..MethodRequest::new(1, 0)
            };
            let refused = method.check(&request, BackendChoice::Cpu).err();
            refused.map(|error| error.to_string())
        };
        let both = ["exposure-compensation", "pose-refinement"];
        assert_eq!(refusal(&odgs::METHOD, &both, &["sky-shell"]), None);
        let unknown = refusal(&odgs::METHOD, &["static-table"], &[]).unwrap_or_default();
        assert!(unknown.contains("static-table") && unknown.contains("pose-refinement"));
        let contradiction = refusal(&odgs::METHOD, &both, &both).unwrap_or_default();
        assert!(
            contradiction.contains("asked for and left out"),
            "{contradiction}"
        );
        for name in both {
            assert!(refusal(&odgs_published::METHOD, &[name], &[]).is_some());
        }
        assert_eq!(refusal(&odgs::METHOD, &[], &[aids::ALL]), None);
        assert_eq!(
            refusal(&odgs::METHOD, &["short-schedule"], &[aids::ALL]),
            None
        );
        let none = refusal(&odgs_published::METHOD, &[], &[aids::ALL]);
        assert!(none.is_some_and(|refusal| refusal.contains("aids")));
    }
}
