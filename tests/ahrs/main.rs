//! Orientation filter: honest covariance, estimated magnetometer errors, odd records, and the recordings with optical truth.

mod carried;
mod consistency;
mod odd;
mod recorded;
