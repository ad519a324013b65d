//! Static transforms of a log: where the antenna is on the body.

use crate::error::LogError;
use crate::log::Log;
use crate::ros2::Transforms;
use crate::samples::imu_to_body;
use crate::topics::Role;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Where one frame is in another, as a log says it.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticTransform {
    /// The frame that the numbers are in.
    pub parent: String,
    /// The frame that is described.
    pub child: String,
    /// Takes points in child coordinates to parent coordinates.
    pub pose: Isometry3<f64>,
}

impl Log {
    /// Every transform on the static transform topic; a later one for the same child replaces the earlier.
    pub fn static_transforms(&self) -> Result<Vec<StaticTransform>, LogError> {
        let Some(topic) = self.selected().topic(Role::Tf) else {
            return Ok(Vec::new());
        };
        let mut by_child = BTreeMap::new();
        let mut messages = self.messages(&[topic]);
        let mut reader = self.reader(topic)?;
        while let Some(message) = messages.next() {
            let message = message?;
            let transforms: Transforms<'_> = reader
                .decode(message.data)
                .map_err(|source| self.undecodable(topic, &message, source))?;
            for transform in transforms.0 {
                let [x, y, z, w] = transform.rotation;
                let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5);
                // A quaternion of zeros is how an unset rotation looks.
                let rotation = rotation.unwrap_or_else(UnitQuaternion::identity);
                let child = frame_name(transform.child_frame_id);
                let pose =
                    Isometry3::from_parts(Translation3::from(transform.translation), rotation);
                let parent = frame_name(transform.header.frame_id);
                by_child.insert(
                    child.clone(),
                    StaticTransform {
                        parent,
                        child,
                        pose,
                    },
                );
            }
        }
        Ok(by_child.into_values().collect())
    }

    /// Antenna from the IMU, forward-right-down, m, when static transforms connect the frames of the two topics.
    ///
    /// `None` when they do not, or when both messages carry the same frame, which says nothing about the antenna.
    pub fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, LogError> {
        let (Some(imu), Some(gnss)) = (
            self.frame_of(Role::Imu)?,
            self.frame_of(Role::GnssPosition)?,
        ) else {
            return Ok(None);
        };
        if imu == gnss {
            return Ok(None);
        }
        let to_body = imu_to_body(self.options().imu_axes, self.options().imu_mounting_rpy_deg);
        let antenna_in_imu = connect(&self.static_transforms()?, &gnss, &imu);
        Ok(antenna_in_imu.map(|pose| to_body * pose.translation.vector))
    }

    /// Frame of the first message of a role's topic; `None` without topic, message or frame.
    pub fn frame_of(&self, role: Role) -> Result<Option<String>, LogError> {
        let Some(topic) = self.selected().topic(role) else {
            return Ok(None);
        };
        let mut messages = self.messages(&[topic]);
        let Some(message) = messages.next().transpose()? else {
            return Ok(None);
        };
        let mut reader = self.reader(topic)?;
        let content = reader
            .content(message.data)
            .map_err(|source| self.undecodable(topic, &message, source))?;
        let name = frame_name(content.frame_id);
        Ok((!name.is_empty()).then_some(name))
    }
}

/// Names written by ROS 1 era drivers begin with a slash that means nothing.
fn frame_name(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

/// The pose of frame `from` in frame `to`, when they have a common ancestor.
fn connect(transforms: &[StaticTransform], from: &str, to: &str) -> Option<Isometry3<f64>> {
    let from = ancestors(transforms, from);
    let to = ancestors(transforms, to);
    from.iter().find_map(|(name, from_pose)| {
        let (_, to_pose) = to.iter().find(|(other, _)| other == name)?;
        Some(to_pose.inverse() * from_pose)
    })
}

/// A frame and its ancestors, each with the pose of the frame in it. Ends at the root or, in a loop, after one round.
fn ancestors<'a>(
    transforms: &'a [StaticTransform],
    frame: &'a str,
) -> Vec<(&'a str, Isometry3<f64>)> {
    let mut chain = vec![(frame, Isometry3::identity())];
    while chain.len() <= transforms.len() {
        let Some((name, pose)) = chain.last().copied() else {
            break;
        };
        let Some(up) = transforms.iter().find(|transform| transform.child == name) else {
            break;
        };
        chain.push((&up.parent, up.pose * pose));
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transform(parent: &str, child: &str, xyz: [f64; 3], yaw_deg: f64) -> StaticTransform {
        let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_deg.to_radians());
        let pose = Isometry3::from_parts(Translation3::from(Vector3::from(xyz)), rotation);
        StaticTransform {
            parent: parent.into(),
            child: child.into(),
            pose,
        }
    }

    #[test]
    fn frames_connect_over_their_common_ancestor() {
        // The IMU looks left: what is ahead of the base is on its right.
        let transforms = [
            transform("base", "imu", [0.5, 0.0, 0.2], 90.0),
            transform("base", "mast", [-1.0, 0.0, 0.0], 0.0),
            transform("mast", "gps", [0.0, 0.0, 2.0], 180.0),
        ];
        let pose = connect(&transforms, "gps", "imu").unwrap();
        assert!(
            (pose.translation.vector - Vector3::new(0.0, 1.5, 1.8)).norm() < 1e-12,
            "{pose}"
        );
        assert_eq!(connect(&transforms, "gps", "elsewhere"), None);
    }

    #[test]
    fn a_loop_of_frames_ends() {
        let transforms = [
            transform("a", "b", [1.0, 0.0, 0.0], 0.0),
            transform("b", "a", [1.0, 0.0, 0.0], 0.0),
        ];
        assert_eq!(connect(&transforms, "a", "elsewhere"), None);
    }
}
