//! Response of the camera in a step: the render is shown through it before the losses.

use serde::{Deserialize, Serialize};

use crate::{
    model::{
        Model, TrainedArray,
        camera_response::{
            CAMERA_CURVE, CAMERA_GAINS, LearntResponse, ResponseGradient, ViewResponse,
        },
    },
    schedule::StepSchedule,
    step::StepStatistics,
};

/// Schedule of a camera's response, and its numbers once they are learnt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResponseSettings {
    /// First iteration of the schedule that changes the response.
    pub begin_iteration: u64,
    /// Numbers at the end of the run, in its record; `None` in settings of training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learnt: Option<LearntResponse>,
}

/// Images of one step, which the next step overwrites.
#[derive(Debug, Default)]
pub(super) struct ResponseMemory {
    shown: Vec<f32>,
    by_render: Vec<f32>,
    /// Gradient by the response of the view that the step drew.
    gradient: ResponseGradient,
}

impl ResponseMemory {
    /// Returns a render as it is compared with an image.
    pub(super) fn shown<'a>(
        &'a mut self,
        response: Option<&ViewResponse>,
        render: &'a [f32],
    ) -> &'a [f32] {
        match response {
            Some(response) => {
                response.show(render, &mut self.shown);
                &self.shown
            }
            None => render,
        }
    }

    /// Returns the gradient by a render from that by the shown one, and keeps that by the response.
    pub(super) fn by_render<'a>(
        &'a mut self,
        response: Option<&ViewResponse>,
        render: &[f32],
        by_shown: &'a [f32],
    ) -> &'a [f32] {
        match response {
            Some(response) => {
                self.gradient = response.show_vjp(render, by_shown, &mut self.by_render);
                &self.by_render
            }
            None => by_shown,
        }
    }

    /// Updates the response at input view number `view` by the kept gradient. `arrays` are those of the model, in the
    /// order of step sizes.
    pub(super) fn update(
        &self,
        (model, arrays): (&mut Model, &[TrainedArray]),
        view: usize,
        settings: Option<&ResponseSettings>,
        schedule: &StepSchedule,
        statistics: &mut StepStatistics,
    ) {
        let (Some(response), Some(settings)) = (&mut model.response, settings) else {
            return;
        };
        if schedule.scheduled < settings.begin_iteration {
            return;
        }
        let place = |name: &str| arrays.iter().position(|array| array.name == name);
        let (Some(gains), Some(shared)) = (place(CAMERA_GAINS), place(CAMERA_CURVE)) else {
            return;
        };
        let places = [gains, shared];
        let rates = places.map(|place| schedule.learning_rates[place]);
        let refused = response.step(view, &self.gradient, rates);
        statistics.refused.resize(arrays.len(), 0);
        for (place, refused) in places.into_iter().zip(refused) {
            statistics.refused[place] += refused as u64;
        }
    }
}

#[cfg(test)]
mod tests;
