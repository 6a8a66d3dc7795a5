//! Static Gaussians whose centres stay near their first samples, and near a scaffold. `gpu`: the twin.

mod gpu;

use std::sync::Arc;

use glam::Vec3;
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians,
        device_twin::DeviceTwin,
        parameterization::{Parameterization, Viewpoint},
        static_gaussians::{self, POSITIONS, StaticGaussians},
        temporal::TemporalFeatures,
    },
    losses::scaffold::Scaffold,
    parameters::ParameterTable,
};

/// Bounds and losses of centres.
#[derive(Debug, Clone)]
pub(super) struct CentreRefinement {
    /// First position of each centre.
    pub(super) anchors: Arc<Vec<[f32; 3]>>,
    /// Maximum distance of each centre from its anchor.
    pub(super) reach: Arc<Vec<f32>>,
    /// The iteration of the schedule from which centres move.
    pub(super) begin_iteration: u64,
    /// The scaffold of the centres.
    pub(super) scaffold: Option<ScaffoldLoss>,
}

/// Loss that keeps centres near a scaffold.
#[derive(Debug, Clone)]
pub(super) struct ScaffoldLoss {
    pub(super) field: Arc<Scaffold>,
    pub(super) weight: ScaffoldWeight,
}

/// Weight of a centre's distance from the scaffold.
#[derive(Debug, Clone, Copy)]
pub(super) enum ScaffoldWeight {
    /// The published weight, the same for every centre: per scene unit.
    Mean(f32),
    /// The weight of a centre in the view's image, whose Gaussian has a gradient by its opacity: per reach of the
    /// centre, a multiple of its sample's pixel. Other centres have none.
    Seen(f32),
}

impl ScaffoldWeight {
    /// Returns the weight of a centre with this reach.
    fn of(self, reach: f32) -> f32 {
        match self {
            Self::Mean(of_each) => of_each,
            Self::Seen(of_each) => of_each / reach,
        }
    }
}

/// Static Gaussians with bounded centres.
#[derive(Debug, Clone, Default)]
pub(super) struct Anchored {
    /// Bounds of the centres; `None` keeps them fixed.
    pub(super) refinement: Option<CentreRefinement>,
}

impl Parameterization for Anchored {
    fn id(&self) -> &'static str {
        "anchored"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        StaticGaussians.activate(table, at, features, first, out);
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        _: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        static_gaussians::activate_from_vjp(table, first, activated, gradient);
        let Some(refinement) = &self.refinement else {
            return;
        };
        let positions = &mut table.arrays[POSITIONS];
        let by_centres = positions.gradients.as_chunks_mut::<3>().0;
        if at.scheduled < Some(refinement.begin_iteration) {
            by_centres.fill([0.0; 3]);
        } else if let Some(scaffold) = &refinement.scaffold {
            let centres = positions.values.as_chunks::<3>().0;
            let by_opacities = &gradient.opacities[first..first + centres.len()];
            let weight = |number: usize| match scaffold.weight {
                ScaffoldWeight::Seen(_) if by_opacities[number] == 0.0 => 0.0,
                weight => weight.of(refinement.reach[number]),
            };
            // Its part of the loss is for the optimizer alone: the trace has the photometric loss.
            scaffold.field.loss(centres, weight, by_centres);
        }
    }

    /// Returns centres to their balls, and removes the outward part of their moments.
    fn keep_within_bounds(&mut self, table: &mut ParameterTable) {
        let Some(refinement) = &self.refinement else {
            return;
        };
        let array = &mut table.arrays[POSITIONS];
        let centres = array.values.as_chunks_mut::<3>().0.iter_mut();
        let moments = array.first_moments.as_chunks_mut::<3>().0.iter_mut();
        let anchors = refinement.anchors.iter().zip(refinement.reach.iter());
        for ((centre, moment), (anchor, &reach)) in centres.zip(moments).zip(anchors) {
            let away = Vec3::from_array(*centre) - Vec3::from_array(*anchor);
            let distance = away.length();
            if distance > reach {
                let outward = away / distance;
                *centre = (Vec3::from_array(*anchor) + outward * reach).to_array();
                let along = Vec3::from_array(*moment);
                // A negative moment is a step outward.
                *moment = (along - outward * along.dot(outward).min(0.0)).to_array();
            }
        }
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        Some(self)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use omnilife_engine::gaussians::static_gaussians::InitialGaussians;

    use super::*;

    #[test]
    fn centres_come_back_into_their_balls_and_lose_their_way_out() {
        let initial = InitialGaussians::isotropic(
            vec![[0.3, 0.0, 0.0], [0.05, 0.0, 0.0]],
            &[0.1; 2],
            vec![[0.5; 3]; 2],
            vec![0.5; 2],
        );
        let mut table = static_gaussians::table(&initial, 0);
        table.arrays[POSITIONS].first_moments = vec![-1.0, 2.0, 0.0, -1.0, 2.0, 0.0];
        let mut anchored = Anchored {
            refinement: Some(CentreRefinement {
                anchors: Arc::new(vec![[0.0; 3]; 2]),
                reach: Arc::new(vec![0.1; 2]),
                begin_iteration: 0,
                scaffold: None,
            }),
        };
        anchored.keep_within_bounds(&mut table);
        assert_eq!(table.row(POSITIONS, 0), [0.1, 0.0, 0.0]);
        assert_eq!(table.row(POSITIONS, 1), [0.05, 0.0, 0.0]);
        let moments = &table.arrays[POSITIONS].first_moments;
        assert_eq!(moments[..], [0.0, 2.0, 0.0, -1.0, 2.0, 0.0]);
    }
}
