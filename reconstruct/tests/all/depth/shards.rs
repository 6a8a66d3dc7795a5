//! Shards of the method: they train like all Gaussians at once, survive an interruption, and are written as one
//! model.

use crate::{
    depth::panogs::{as_given, is_used, prepared, scene},
    support::trained::files,
};
use omnilife_engine::{
    gaussians::static_gaussians::{LOG_SCALES, QUATERNIONS, SH_CONSTANT},
    model::Model,
    parameters::ParameterTable,
};
use omnilife_reconstruct::{
    formats::{self, GAUSSIANS_FILE},
    methods::{self, MethodOutcome, Prepared},
    options::Options,
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::{Session, TrainingFiles},
};
use omnilife_schemas::{RgbImage, progress::Silent, records::InvalidGaussians};

/// Returns a request in which centres are trained with the scaffold's loss.
fn request(shards: u64, iterations: u64) -> MethodRequest {
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    MethodRequest {
        with: owned(&["centre-refinement", "scaffold"]),
        options: Options::in_shards(shards),
        ..MethodRequest::new(iterations, 0)
    }
}

fn train<'a>(
    scene: &'a TrainingScene,
    request: &MethodRequest,
    files: Option<TrainingFiles>,
) -> MethodOutcome<'a> {
    let session = Session {
        files,
        ..Session::without_files(&Silent)
    };
    let method = methods::find("panogs").unwrap();
    method.train(scene, request, &session).unwrap()
}

/// Returns all rows of a model in an order that depends on the rows alone.
fn rows(model: &Model) -> Vec<Vec<u32>> {
    let row = |table: &ParameterTable, index: usize| {
        let arrays = 0..table.arrays.len();
        let values = arrays.flat_map(|array| table.row(array, index).to_vec());
        values.map(f32::to_bits).collect::<Vec<u32>>()
    };
    let tables = model.parts.iter().map(|part| &part.table);
    let mut rows: Vec<Vec<u32>> = tables
        .flat_map(|table| (0..table.len()).map(move |index| row(table, index)))
        .collect();
    rows.sort_unstable();
    rows
}

#[test]
fn one_shard_and_eight_learn_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 4, as_given);
    let [mut one, mut eight] = [1, 8].map(|shards| train(&scene, &request(shards, 12), None));
    let whole = one.learner.gaussians().unwrap().unwrap().len();
    let model = eight.learner.gaussians().unwrap().unwrap();
    assert_eq!(model.parts.len(), 8);
    let model_len = model.len();
    for part in &model.parts {
        for learnt in [LOG_SCALES, QUATERNIONS, SH_CONSTANT] {
            assert!(!part.table.arrays[learnt].first_moments.is_empty());
        }
    }
    let view = scene.input_views[1].view;
    let [first, second] =
        [&mut one, &mut eight].map(|outcome| outcome.learner.image(&view).unwrap());
    // Gaussians of equal distances are drawn in the order of the table, which is another one in shards. Training
    // from one order is equal to the last bit (omnilife-engine, step/shards.rs).
    let psnr = |image: &RgbImage, other: &RgbImage| {
        let values = image.data.iter().zip(&other.data);
        let sum: f64 = values.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        -10.0 * (sum / image.data.len() as f64).log10()
    };
    let given = RgbImage::from_rgb8(128, 64, &scene.input_views[1].pixels);
    let [own, of_eight] = [&first, &second].map(|image| psnr(image, &given));
    assert!((own - of_eight).abs() < 0.02, "{own} and {of_eight} dB");
    assert!(psnr(&first, &second) > 45.0, "{} dB", psnr(&first, &second));
    assert!(eight.learner.size().bytes < one.learner.size().bytes);
    let written = eight.learner.export(folder.path()).unwrap();
    assert_eq!(written, [GAUSSIANS_FILE]);
    let path = folder.path().join(GAUSSIANS_FILE);
    let mut invalid = InvalidGaussians::default();
    let read = formats::read_static(&path, &scene.normalization, &mut invalid).unwrap();
    assert_eq!([read.table.len(), model_len], [whole; 2]);
}

#[test]
fn what_does_not_learn_has_no_moments_in_any_shard() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 4, as_given);
    let as_published = MethodRequest {
        without: vec!["shape-refinement".to_owned()],
        ..request(8, 2)
    };
    let mut outcome = train(&scene, &as_published, None);
    let model = outcome.learner.gaussians().unwrap().unwrap();
    assert_eq!(model.parts.len(), 8);
    for part in &model.parts {
        for frozen in [LOG_SCALES, QUATERNIONS] {
            assert!(part.table.arrays[frozen].first_moments.is_empty());
        }
        assert!(!part.table.arrays[SH_CONSTANT].first_moments.is_empty());
    }
}

#[test]
fn shards_go_on_from_a_checkpoint_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 4, as_given);
    let request = request(3, 16);
    // The remaining checkpoint is of iteration 10.
    let mut whole = train(&scene, &request, Some(files(folder.path(), 10)));
    let mut continued = train(&scene, &request, Some(files(folder.path(), 10)));
    assert_eq!(continued.training.state.resumed, 1);
    let [whole, continued] = [&mut whole, &mut continued].map(|outcome| {
        let model = outcome.learner.gaussians().unwrap().unwrap();
        (
            rows(model),
            model
                .parts
                .iter()
                .map(|part| part.steps)
                .collect::<Vec<_>>(),
        )
    });
    assert!(whole == continued);
    // With another number of shards it belongs to another run.
    let other = MethodRequest {
        options: Options::in_shards(2),
        ..request
    };
    let other = train(&scene, &other, Some(files(folder.path(), 10)));
    assert_eq!(other.training.state.resumed, 0);
}

#[test]
fn what_fits_into_memory_has_no_case_for_shards_and_gets_them_by_name_alone() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 4, as_given);
    let plain = MethodRequest::new(10, 0);
    let reason = |prepared: &Prepared<'_>, component: &str| {
        let mut plan = prepared.findings.plan.iter();
        let decision = plan.find(|decision| decision.component == component);
        decision.unwrap().reason.clone()
    };
    for plan in [PlanChoice::Auto, PlanChoice::Full] {
        let plain = MethodRequest {
            plan,
            ..plain.clone()
        };
        let plain = prepared(&scene, &plain);
        assert!(!is_used(&plain, "shards") && !is_used(&plain, "neighbour-views"));
        let shards = reason(&plain, "shards");
        assert!(
            shards.starts_with("no case: ") && shards.contains(" GB"),
            "{shards}"
        );
        let near = reason(&plain, "neighbour-views");
        assert_eq!(near, "cannot be without shards");
    }
    let named = |with: &[&str]| {
        let with = with.iter().map(|&name| name.to_owned()).collect();
        let request = MethodRequest {
            with,
            ..plain.clone()
        };
        prepared(&scene, &request)
    };
    let without = named(&["shards"]);
    assert!(is_used(&without, "shards"));
    let shards = reason(&without, "shards");
    assert!(
        shards.contains(" GB less") && shards.contains("CPU seconds a step more"),
        "{shards}"
    );
    let near = reason(&without, "neighbour-views");
    let has_case = !near.starts_with("no case: ");
    assert_eq!(is_used(&without, "neighbour-views"), has_case, "{near}");
    let full = named(&["shards", "neighbour-views"]);
    assert!(is_used(&full, "shards") && is_used(&full, "neighbour-views"));
    let plain = prepared(&scene, &plain);
    let shards = full.configuration["shards"]["gaussians"]
        .as_array()
        .unwrap();
    let gaussians: u64 = shards.iter().filter_map(serde_json::Value::as_u64).sum();
    assert_eq!(shards.len(), 8);
    assert_eq!(gaussians, plain.learner.size().primitives);
}
