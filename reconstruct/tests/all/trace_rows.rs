//! Rows of the trace: their iterations, and unchanged models after their renders.

use std::path::Path;

use omnilife_engine::model::Model;
use omnilife_reconstruct::{
    methods,
    request::MethodRequest,
    scene::TrainingScene,
    train::{
        Session, TrainingFiles,
        trace::TracePoint,
        trace_views::TraceViews,
        watch::{WatchFiles, page::Page},
    },
};
use omnilife_schemas::progress::Silent;

use crate::support::{balls, moving_ball};

const ITERATIONS: u64 = 40;

/// Runs a training with its novel views rendered at the rows, if it has a folder for them.
fn run(
    scene: &TrainingScene,
    method: &str,
    trace_every: Option<u64>,
    folder: Option<&Path>,
) -> (Model, Vec<TracePoint>) {
    let frames: Vec<u32> = scene.novel_views.iter().map(|view| view.frame).collect();
    let files = folder.map(|folder| TrainingFiles {
        trace: folder.join("trace.csv"),
        trace_views: Some(TraceViews::new(folder.join("trace"), &frames, None)),
        watch: WatchFiles {
            page: Some(Page {
                file: folder.join("progress.html"),
                title: method.to_owned(),
            }),
            tensorboard: Some(folder.join("events")),
        },
        checkpoint: folder.join("checkpoint.bin"),
        checkpoint_every: 0,
        inputs_sha256: String::new(),
    });
    let session = Session {
        files,
        ..Session::without_files(&Silent)
    };
    let request = MethodRequest {
        trace_every,
        ..MethodRequest::new(ITERATIONS, 7)
    };
    let method = methods::find(method).unwrap();
    let mut outcome = method.train(scene, &request, &session).unwrap();
    let model = outcome.learner.gaussians().unwrap().unwrap().clone();
    (model, outcome.training.state.trace)
}

#[test]
fn looking_at_a_model_does_not_change_it() {
    for (method, scene) in [
        ("odgs", balls::scene()),
        ("omni4dgs-plus", moving_ball::scene()),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (traced, rows) = run(&scene, method, None, Some(folder.path()));
        let (every_step, _) = run(&scene, method, Some(1), None);
        let (untraced, ends) = run(&scene, method, Some(ITERATIONS), None);
        assert!(traced == untraced && every_step == untraced, "{method}");
        let iterations =
            |rows: &[TracePoint]| -> Vec<u64> { rows.iter().map(|row| row.iteration).collect() };
        // After planning, at equal ratios of time in between, and at the end.
        let of_rows = iterations(&rows);
        assert_eq!(
            (of_rows[0], of_rows.last()),
            (0, Some(&ITERATIONS)),
            "{method}"
        );
        assert!(of_rows.is_sorted_by(|one, next| one < next), "{of_rows:?}");
        assert_eq!(iterations(&ends), [0, ITERATIONS], "{method}");
        // The views of the last row are the run's predictions.
        for row in &rows[..rows.len() - 1] {
            for view in &scene.novel_views {
                let file = TraceViews::file(row.iteration, view.frame);
                assert!(folder.path().join("trace").join(file).is_file(), "{method}");
            }
        }
        let page = std::fs::read_to_string(folder.path().join("progress.html")).unwrap();
        assert!(page.contains("iteration 40 of 40"), "{page}");
        let before = rows[rows.len() - 2].iteration;
        let shown = TraceViews::file(before, scene.novel_views[scene.novel_views.len() / 2].frame);
        assert!(page.contains(&format!("src=\"trace/{shown}\"")), "{page}");
        let mut events = std::fs::read_dir(folder.path().join("events")).unwrap();
        let events = std::fs::read(events.next().unwrap().unwrap().path()).unwrap();
        let count = |text: &str| {
            let parts = events.windows(text.len());
            parts.filter(|part| *part == text.as_bytes()).count()
        };
        assert_eq!(count("trace/iteration"), rows.len(), "{method}");
        // Rows in between may be without views; the last one is not.
        assert!(
            count("views/input") >= 2 && count("views/novel") >= 2,
            "{method}"
        );
        assert!(rows[0].wall_seconds > 0.0 && rows[0].wall_seconds < rows[1].wall_seconds);
        assert_eq!(rows[0].train_loss, None);
        assert!(rows[1..].iter().all(|row| row.train_loss.is_some()));
    }
}
