//! Validation and levelling of models.

use super::*;

/// A made-up model without errors: `frames` cameras along a line amid points on a sphere, all seen
/// by all. The world is tilted.
fn perfect(frames: u32, tilt: DQuat) -> (ColmapModel, Vec<String>) {
    let camera = ErpCamera::new(1024, 512);
    let ids: Vec<u32> = (1..=frames).collect();
    let points: std::collections::BTreeMap<u64, ColmapPoint> = (0..300_u64)
        .map(|id| {
            // A golden-angle spiral spreads points over the sphere.
            let y = 1.0 - 2.0 * (id as f64 + 0.5) / 300.0;
            let angle = id as f64 * 2.399_963;
            let ring = (1.0 - y * y).sqrt();
            let position = 8.0 * DVec3::new(ring * angle.cos(), y, ring * angle.sin());
            let point = ColmapPoint {
                position: tilt * position,
                colour: [1, 2, 3],
                track: ids.clone(),
            };
            (id, point)
        })
        .collect();
    let images = ids
        .iter()
        .map(|&id| {
            let rotation = tilt * DQuat::from_rotation_y(0.02 * f64::from(id));
            let centre = tilt * DVec3::new(0.2 * f64::from(id), 0.0, 0.0);
            let observations = points
                .iter()
                .map(|(&point, entry)| {
                    let seen = rotation.inverse() * (entry.position - centre);
                    (camera.project(seen).unwrap(), point)
                })
                .collect();
            let image = ColmapImage {
                name: format!("{:06}.png", id - 1),
                rotation,
                centre,
                observations,
            };
            (id, image)
        })
        .collect();
    let names = (0..frames).map(|index| format!("{index:06}.png")).collect();
    let model = ColmapModel {
        camera: Camera::from(camera).into(),
        images,
        points,
    };
    (model, names)
}

#[test]
fn validation_passes_what_is_sound_and_names_what_is_not() {
    let limits = ValidationLimits::default();
    let (sound, names) = perfect(20, DQuat::IDENTITY);
    let report = validate(&sound, &names, &limits);
    assert_eq!(report.problems, Vec::<String>::new());
    assert_eq!(report.status, ValidationStatus::Valid);
    assert!(report.measures["median_error_degrees"] < 1e-9);
    assert_eq!(report.measures["mean_track"], 20.0);
    assert!((report.measures["step_ratio"] - 1.0).abs() < 1e-9);

    let broken = |breaks: &dyn Fn(&mut ColmapModel), problem: &str| {
        let (mut model, names) = perfect(20, DQuat::IDENTITY);
        breaks(&mut model);
        let report = validate(&model, &names, &limits);
        assert_eq!(report.status, ValidationStatus::Unstable, "{problem}");
        assert!(
            report
                .problems
                .iter()
                .any(|found| found.starts_with(problem)),
            "{problem}: {:?}",
            report.problems
        );
    };
    broken(
        &|model| drop(model.images.split_off(&15)),
        "registered_share",
    );
    broken(
        &|model| {
            if let Some(image) = model.images.get_mut(&9) {
                image.centre += DVec3::new(0.0, 1.5, 0.0);
            }
        },
        "step_ratio",
    );
    broken(
        &|model| {
            if let Some(image) = model.images.get_mut(&9) {
                image.rotation *= DQuat::from_rotation_x(0.3);
            }
        },
        "rotation_change_ratio",
    );
    broken(
        &|model| {
            for image in model.images.values_mut() {
                for (pixel, _) in &mut image.observations {
                    pixel.x += 1.0;
                }
            }
        },
        "median_error_degrees",
    );
    broken(
        &|model| {
            if let Some(image) = model.images.get_mut(&3) {
                image.observations.truncate(40);
            }
        },
        "fewest_points",
    );
    broken(
        &|model| {
            for point in model.points.values_mut() {
                point.track.truncate(2);
            }
        },
        "mean_track",
    );
    broken(
        &|model| {
            for image in model.images.values_mut() {
                image.centre *= 1e-3;
            }
        },
        "median_triangulation_degrees",
    );
    let empty = ColmapModel {
        images: Default::default(),
        points: Default::default(),
        ..sound
    };
    let report = validate(&empty, &names, &limits);
    assert_eq!(report.status, ValidationStatus::Unstable);
    assert!(
        report
            .problems
            .contains(&"median_error_degrees cannot be measured".to_owned())
    );
}

/// Measures of poses are angles and ratios, wherever the world has its origin.
#[test]
fn a_model_far_from_the_origin_is_as_sound_as_near_it() {
    let limits = ValidationLimits::default();
    let (near, names) = perfect(20, DQuat::IDENTITY);
    let (mut far, _) = perfect(20, DQuat::IDENTITY);
    let turn = DQuat::from_rotation_y(0.7);
    let offset = DVec3::new(5e5, 0.0, 5e6);
    for point in far.points.values_mut() {
        point.position = turn * point.position + offset;
    }
    for image in far.images.values_mut() {
        image.rotation = turn * image.rotation;
        image.centre = turn * image.centre + offset;
    }
    let [near, far] = [near, far].map(|model| validate(&model, &names, &limits));
    assert_eq!((far.status, &far.problems), (near.status, &near.problems));
    assert_eq!(far.measures.len(), near.measures.len());
    for (name, value) in &near.measures {
        let error = (far.measures[name] - value).abs();
        // Angles of nearly equal directions are by the square root of rounding.
        assert!(error < 1e-5 * (1.0 + value.abs()), "{name}: {error}");
    }
}

#[test]
fn levelling_turns_the_world_upright_and_changes_nothing_else() {
    let tilt = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.1);
    let (mut model, names) = perfect(12, tilt);
    let before = validate(&model, &names, &ValidationLimits::default());
    let levelling = level(&mut model);
    assert!(
        matches!(levelling, Levelling::ByCameras { agreement } if agreement > 0.999),
        "{levelling:?}"
    );
    for image in model.images.values() {
        assert!((image.rotation * DVec3::NEG_Y - UP).length() < 1e-9);
    }
    let after = validate(&model, &names, &ValidationLimits::default());
    for (name, value) in &before.measures {
        assert!((value - after.measures[name]).abs() < 1e-6, "{name}");
    }

    // Cameras in all attitudes have no common up.
    for (index, image) in model.images.values_mut().enumerate() {
        image.rotation = DQuat::from_rotation_x(std::f64::consts::TAU * index as f64 / 12.0);
    }
    let untouched = model.clone();
    assert!(matches!(level(&mut model), Levelling::None { .. }));
    assert_eq!(model, untouched);
}
