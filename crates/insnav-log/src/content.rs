//! What a message says, once its encoding and its type are out of the way.

use crate::cdr::CdrReader;
use crate::device;
use crate::message::MessageKind;
use crate::ros2::{
    Bool, CovarianceType, Decode, Float32, Float64, Header, Imu, MagneticField, NavSatFix,
    Odometry, Transforms, TwistStamped, TwistWithCovarianceStamped,
};
use crate::topic_map::TopicMap;
use crate::velocity_axes::VelocityAxes;
use crate::wire::{
    DecodeError, Definition, DefinitionError, Document, Fields, LocationFixLayout, Ros1Reader,
    read_json, read_location_fix,
};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// A stamp and whose clock it is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stamp {
    /// The clock of the machine that recorded, or one kept equal to it; zero where the driver sets none.
    Host(Time),
    /// A clock of the sensor's own: time since its power-on, or a receiver's time.
    Own(Time),
    /// Messages of this type have none: the log time it is.
    Absent,
}

/// What a message says, in SI (angles of a position in degrees).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Content<'a> {
    pub(crate) stamp: Stamp,
    pub(crate) frame_id: &'a str,
    pub(crate) rates: Option<Rates>,
    pub(crate) position: Option<Fix>,
    pub(crate) velocity: Option<Velocity>,
    pub(crate) heading: Option<NorthHeading>,
    pub(crate) standing: Option<Declared>,
    /// Magnetic field, T.
    pub(crate) field: Option<(Vector3<f64>, Axes)>,
}

impl<'a> Content<'a> {
    /// Nothing that the navigator takes.
    #[inline]
    pub(crate) fn empty(stamp: Stamp, frame_id: &'a str) -> Self {
        Content {
            stamp,
            frame_id,
            rates: None,
            position: None,
            velocity: None,
            heading: None,
            standing: None,
            field: None,
        }
    }
}

/// Angular rate and specific force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rates {
    pub(crate) angular_rate: Vector3<f64>,
    pub(crate) specific_force: Vector3<f64>,
    pub(crate) axes: Axes,
}

/// Axes of an inertial message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axes {
    /// The user says; else forward-left-up.
    AsRead,
    /// Forward-left-up, by the message's definition or the user's map.
    Flu,
    /// Forward-right-down, by the message's definition or the user's map.
    Frd,
}

/// A position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fix {
    pub(crate) no_fix: bool,
    pub(crate) latitude_deg: f64,
    pub(crate) longitude_deg: f64,
    pub(crate) height_m: f64,
    /// Known to be above the ellipsoid, whatever the user says of altitudes.
    pub(crate) ellipsoidal: bool,
    /// East, north, up, m².
    pub(crate) covariance_enu: Option<Matrix3<f64>>,
}

/// A velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Velocity {
    pub(crate) no_fix: bool,
    /// Axes by a convention that drivers do not always keep: the user may say others.
    pub(crate) by_convention: bool,
    /// East, north, up, m/s.
    pub(crate) enu: Vector3<f64>,
    pub(crate) covariance_enu: Option<Matrix3<f64>>,
}

impl Velocity {
    /// In east, north, up, if the message's axes are these.
    pub(crate) fn read_with(&self, axes: VelocityAxes) -> Velocity {
        if !self.by_convention {
            return *self;
        }
        Velocity {
            enu: axes.to_enu(&self.enu),
            covariance_enu: self.covariance_enu.map(|p| axes.covariance_to_enu(&p)),
            ..*self
        }
    }
}

/// A heading, rad clockwise from true north, and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NorthHeading {
    pub(crate) heading: f64,
    pub(crate) sigma: f64,
}

/// What somebody says about standing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Declared {
    /// Whether the body stands.
    Standing(bool),
    /// How fast the wheels turn, m/s.
    Speed(f64),
}

impl Content<'_> {
    /// Whether rates, velocity, heading and speed are numbers; a position is judged where it is taken.
    pub(crate) fn is_finite(&self) -> bool {
        let rates = self.rates.as_ref();
        let velocity = self.velocity.as_ref();
        let heading = self.heading.as_ref();
        rates.is_none_or(|r| (r.angular_rate.sum() + r.specific_force.sum()).is_finite())
            && velocity.is_none_or(|v| (v.enu.x + v.enu.y).is_finite())
            && heading.is_none_or(|h| (h.heading + h.sigma).is_finite())
            && self.field.is_none_or(|(b, _)| b.sum().is_finite())
            && !matches!(self.standing, Some(Declared::Speed(v)) if !v.is_finite())
    }
}

/// How the messages of a topic are encoded.
#[derive(Clone, Debug)]
pub(crate) enum Format {
    Cdr,
    Ros1,
    Json,
    CdrBy(Arc<Definition>),
    Ros1By(Arc<Definition>),
    LocationFix(LocationFixLayout),
}

impl Format {
    /// How to read messages of a kind. `None`: not at all; an error: it could be but for the definition.
    pub(crate) fn of(
        kind: MessageKind,
        encoding: &str,
        language: &str,
        definition: &[u8],
    ) -> Option<Result<Self, DefinitionError>> {
        let by_definition = || Definition::parse(language, definition).map(Arc::new);
        Some(match encoding {
            "cdr" if kind.is_fixed() => Ok(Format::Cdr),
            "ros1" if kind.is_fixed() => Ok(Format::Ros1),
            "cdr" => by_definition().map(Format::CdrBy),
            "ros1" => by_definition().map(Format::Ros1By),
            "json" => Ok(Format::Json),
            "protobuf" if kind == MessageKind::LocationFix => {
                LocationFixLayout::check(definition).map(Format::LocationFix)
            }
            _ => return None,
        })
    }
}

/// Reads the messages of one topic; its memory is kept from message to message.
#[derive(Clone, Debug)]
pub(crate) struct MessageReader {
    kind: MessageKind,
    format: Format,
    map: Option<Arc<TopicMap>>,
    document: Document,
}

impl MessageReader {
    pub(crate) fn new(kind: MessageKind, format: Format, map: Option<Arc<TopicMap>>) -> Self {
        MessageReader {
            kind,
            format,
            map,
            document: Document::default(),
        }
    }

    /// A message of a type whose fields have a fixed order.
    #[inline]
    pub(crate) fn decode<'a, M: Decode<'a>>(
        &'a mut self,
        message: &'a [u8],
    ) -> Result<M, DecodeError> {
        match &self.format {
            Format::Cdr => M::read(&mut CdrReader::new(message)?),
            Format::Ros1 => M::read(&mut Ros1Reader::new(message)),
            _ => M::read(&mut self.fields(message)?),
        }
    }

    /// The fields by name.
    pub(crate) fn fields<'a>(&'a mut self, message: &'a [u8]) -> Result<Fields<'a>, DecodeError> {
        let document = &mut self.document;
        match &self.format {
            Format::CdrBy(definition) => definition.read_cdr(document, message),
            Format::Ros1By(definition) => definition.read_ros1(document, message),
            Format::LocationFix(layout) => read_location_fix(*layout, document, message),
            Format::Json | Format::Cdr | Format::Ros1 => read_json(document, message),
        }
    }

    /// What a message says.
    #[inline]
    pub(crate) fn content<'a>(&'a mut self, message: &'a [u8]) -> Result<Content<'a>, DecodeError> {
        if self.kind == MessageKind::Imu {
            return Ok(imu(&self.decode(message)?));
        }
        self.other_content(message)
    }

    fn other_content<'a>(&'a mut self, message: &'a [u8]) -> Result<Content<'a>, DecodeError> {
        Ok(match self.kind {
            MessageKind::Imu => imu(&self.decode(message)?),
            MessageKind::NavSatFix => nav_sat_fix(&self.decode(message)?),
            MessageKind::TwistStamped => {
                let twist: TwistStamped<'_> = self.decode(message)?;
                Content {
                    standing: Some(speed(&twist.twist.linear)),
                    ..velocity(twist.header, twist.twist.linear, None)
                }
            }
            MessageKind::TwistWithCovarianceStamped => {
                let twist: TwistWithCovarianceStamped<'_> = self.decode(message)?;
                let covariance = covariance_block(&twist.covariance);
                velocity(twist.header, twist.twist.linear, covariance)
            }
            MessageKind::Odometry => {
                let odometry: Odometry<'_> = self.decode(message)?;
                Content {
                    standing: Some(speed(&odometry.twist.linear)),
                    ..other(odometry.header)
                }
            }
            MessageKind::MagneticField => {
                let message: MagneticField<'_> = self.decode(message)?;
                Content {
                    field: Some((message.magnetic_field, Axes::AsRead)),
                    ..other(message.header)
                }
            }
            MessageKind::VehicleMagnetometer => {
                device::vehicle_magnetometer(&mut self.fields(message)?)?
            }
            MessageKind::Bool => declared(Declared::Standing(self.decode::<Bool>(message)?.0)),
            MessageKind::Float32 => {
                declared(Declared::Speed(self.decode::<Float32>(message)?.0.into()))
            }
            MessageKind::Float64 => declared(Declared::Speed(self.decode::<Float64>(message)?.0)),
            MessageKind::Stamped => other(self.decode::<Stamped<'_>>(message)?.0),
            MessageKind::Transforms => {
                let transforms: Transforms<'_> = self.decode(message)?;
                other(transforms.0.first().map(|t| t.header).unwrap_or_default())
            }
            MessageKind::LocationFix => device::location_fix(&mut self.fields(message)?)?,
            MessageKind::GpsFix => device::gps_fix(&mut self.fields(message)?)?,
            MessageKind::NavPvt => device::nav_pvt(&mut self.fields(message)?)?,
            MessageKind::NavRelPosNed => device::nav_rel_pos_ned(&mut self.fields(message)?)?,
            MessageKind::SensorCombined => device::sensor_combined(&mut self.fields(message)?)?,
            MessageKind::SensorGps => device::sensor_gps(&mut self.fields(message)?)?,
            MessageKind::Mapped => match self.map.clone() {
                Some(map) => map.read(&self.fields(message)?)?,
                None => other(Header::default()),
            },
        })
    }
}

/// The header that a message begins with; the rest is not looked at.
struct Stamped<'a>(Header<'a>);

impl<'a> Decode<'a> for Stamped<'a> {
    fn read<W: crate::wire::Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Header::of(from).map(Stamped)
    }
}

fn other(header: Header<'_>) -> Content<'_> {
    Content::empty(Stamp::Host(header.stamp), header.frame_id)
}

/// A message of one value, which has no header.
fn declared<'a>(what: Declared) -> Content<'a> {
    Content {
        standing: Some(what),
        ..Content::empty(Stamp::Absent, "")
    }
}

/// What wheels do along the ground: forward, and sideways where they can.
fn speed(linear: &Vector3<f64>) -> Declared {
    Declared::Speed(linear.x.hypot(linear.y))
}

#[inline]
fn imu<'a>(imu: &Imu<'a>) -> Content<'a> {
    Content {
        rates: Some(Rates {
            angular_rate: imu.angular_velocity,
            specific_force: imu.linear_acceleration,
            axes: Axes::AsRead,
        }),
        ..other(imu.header)
    }
}

fn nav_sat_fix<'a>(fix: &NavSatFix<'a>) -> Content<'a> {
    Content {
        position: Some(Fix::from(fix)),
        ..other(fix.header)
    }
}

impl From<&NavSatFix<'_>> for Fix {
    fn from(fix: &NavSatFix<'_>) -> Self {
        Fix {
            // −2, "not yet set" of later definitions, is the default of drivers that never set it: the numbers decide.
            no_fix: fix.status == -1,
            latitude_deg: fix.latitude_deg,
            longitude_deg: fix.longitude_deg,
            height_m: fix.altitude_m,
            ellipsoidal: false,
            covariance_enu: stated_covariance(
                fix.position_covariance_type,
                &fix.position_covariance,
            ),
        }
    }
}

/// A covariance row by row, unless it is said to be worth nothing.
pub(crate) fn stated_covariance(kind: CovarianceType, rows: &[f64; 9]) -> Option<Matrix3<f64>> {
    (kind != CovarianceType::Unknown).then(|| Matrix3::from_row_slice(rows))
}

fn velocity<'a>(
    header: Header<'a>,
    enu: Vector3<f64>,
    covariance_enu: Option<Matrix3<f64>>,
) -> Content<'a> {
    Content {
        velocity: Some(Velocity {
            no_fix: false,
            by_convention: true,
            enu,
            covariance_enu,
        }),
        ..other(header)
    }
}

/// The upper left block of a 6 × 6 covariance; `None` when its first element is −1, which in ROS says "not known".
fn covariance_block(covariance: &[f64; 36]) -> Option<Matrix3<f64>> {
    (covariance[0] >= 0.0).then(|| Matrix3::from_fn(|i, j| covariance[6 * i + j]))
}
