//! Static transforms of a log: how the IMU sits on the body, and where the antenna is.

use crate::error::LogError;
use crate::log::{ImuAxes, Log};
use crate::ros2::Transforms;
use crate::samples::imu_to_body;
use crate::topics::Role;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

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

/// How the IMU is mounted, as a log's static transforms say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mounting {
    /// Roll, pitch, yaw of the IMU's axes in those of the body, forward-left-up, degrees.
    pub rpy_deg: [f64; 3],
    /// Frame of the body.
    pub base_frame: String,
    /// Frame of the IMU.
    pub imu_frame: String,
}

impl fmt::Display for Mounting {
    /// The angles, where they come from, and what goes before them.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [roll, pitch, yaw] = self.rpy_deg;
        write!(
            f,
            "mounted at roll {roll:.2}, pitch {pitch:.2}, yaw {yaw:.2}° (forward-left-up), by the log's transforms from {} to {}; \
             --imu-mounting-deg goes before them",
            self.base_frame, self.imu_frame
        )
    }
}

/// Frames of the body, as robots name them, with or without a namespace; the first that the IMU's frame is connected with.
const BASE_FRAMES: [&str; 3] = ["base_link", "base_footprint", "base"];
/// Below this angle, rad, a transform turns nothing.
const TURNS_NOTHING: f64 = 1e-6;

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
        let to_body = imu_to_body(self.options().imu_axes, self.mounting_rpy_deg()?);
        let antenna_in_imu = connect(&self.static_transforms()?, &gnss, &imu);
        Ok(antenna_in_imu.map(|pose| to_body * pose.translation.vector))
    }

    /// How the IMU is mounted by the log's static transforms, when these connect its frame with that of the body and turn it.
    ///
    /// `None` too when the user gave a mounting, or said that the messages are forward-right-down: what the user says goes
    /// before the transforms, which relate forward-left-up frames.
    pub fn mounting(&self) -> Result<Option<&Mounting>, LogError> {
        if self.mounting.get().is_none() {
            let found = self.find_mounting()?;
            // Whoever was first: the value is the same.
            let _ = self.mounting.set(found);
        }
        Ok(self.mounting.get().and_then(Option::as_ref))
    }

    /// Roll, pitch, yaw of the IMU in the axes of the options: as the user gave it, else by the transforms.
    pub(crate) fn mounting_rpy_deg(&self) -> Result<Option<[f64; 3]>, LogError> {
        match self.options().imu_mounting_rpy_deg {
            None => Ok(self.mounting()?.map(|mounting| mounting.rpy_deg)),
            given => Ok(given),
        }
    }

    fn find_mounting(&self) -> Result<Option<Mounting>, LogError> {
        let options = self.options();
        if options.imu_mounting_rpy_deg.is_some() || options.imu_axes != ImuAxes::Flu {
            return Ok(None);
        }
        if self.selected().topic(Role::Tf).is_none() {
            return Ok(None);
        }
        let Some(imu_frame) = self.frame_of(Role::Imu)? else {
            return Ok(None);
        };
        Ok(mounting(&self.static_transforms()?, &imu_frame))
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

/// The rotation of the IMU's frame against that of the body.
fn mounting(transforms: &[StaticTransform], imu_frame: &str) -> Option<Mounting> {
    let frames = || {
        transforms
            .iter()
            .flat_map(|transform| [&transform.parent, &transform.child])
    };
    BASE_FRAMES.iter().find_map(|base| {
        let is_base = |frame: &&String| frame.rsplit('/').next() == Some(base);
        frames().filter(is_base).find_map(|base| {
            let pose = connect(transforms, imu_frame, base)?;
            // A frame that is the body's own, or not turned against it, has no mounting.
            let (roll, pitch, yaw) = pose.rotation.euler_angles();
            (pose.rotation.angle() > TURNS_NOTHING).then(|| Mounting {
                rpy_deg: [roll, pitch, yaw].map(f64::to_degrees),
                base_frame: base.clone(),
                imu_frame: imu_frame.to_owned(),
            })
        })
    })
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
    fn the_mounting_is_that_of_the_imu_in_the_body() {
        // base_link → plate → imu, the IMU upside down on a plate that looks left; the body above a footprint.
        let mut plate = transform("husky/base_link", "husky/plate", [0.1, 0.0, 0.2], 90.0);
        let mut imu = transform("husky/plate", "husky/imu", [0.0, 0.0, 0.0], 0.0);
        imu.pose.rotation = UnitQuaternion::from_euler_angles(180f64.to_radians(), 0.0, 0.0);
        let footprint = transform("base_footprint", "husky/base_link", [0.0, 0.0, 0.3], 0.0);
        let transforms = [plate.clone(), imu.clone(), footprint];
        let found = mounting(&transforms, "husky/imu").unwrap();
        assert_eq!(found.base_frame, "husky/base_link");
        let expected = [180.0, 0.0, 90.0];
        let close = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(close(&found.rpy_deg, &expected), "{found:?}");
        // The same tree hung up at the IMU: each transform the other way round.
        for link in [&mut plate, &mut imu] {
            std::mem::swap(&mut link.parent, &mut link.child);
            link.pose = link.pose.inverse();
        }
        let found = mounting(&[plate, imu], "husky/imu").unwrap();
        assert!(close(&found.rpy_deg, &expected), "{found:?}");
        // Not turned, not connected, or the body's own frame.
        assert_eq!(
            mounting(
                &[transform("base_link", "imu", [1.0, 0.0, 0.0], 0.0)],
                "imu"
            ),
            None
        );
        assert_eq!(
            mounting(&[transform("base_link", "a", [0.0; 3], 9.0)], "imu"),
            None
        );
        assert_eq!(
            mounting(&[transform("base_link", "a", [0.0; 3], 9.0)], "base_link"),
            None
        );
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
