//! What is compared.

use serde::{Deserialize, Serialize};

/// A way to set Q and R of the filter of attitude, and whether there is a gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeVariant {
    /// No filter: angles of accelerometer and magnetometer.
    Raw,
    /// Q and R of the data sheet.
    Datasheet,
    /// The same behind a gate that does not lock out.
    DatasheetGated,
    /// The same behind a plain gate at four sigmas: for comparison.
    DatasheetPlainGate,
    /// Q a hundred times too large.
    QX100,
    /// Mohamed and Schwarz' Q of a window of forty, with the true R.
    MohamedSchwarzFair,
    /// The same with a tenth of it.
    MohamedSchwarzROver10,
    /// Their R of residuals, with the true Q.
    MohamedSchwarzR,
    /// Both from the same window.
    MohamedSchwarzQAndR,
    /// The paper's recursion with t = 0.3, with the true R.
    PaperRecursion,
    /// Autocovariance least squares on blocks of forty innovations, unconstrained, nine unknowns; what is negative is replaced by a
    /// hundredth of the start.
    AlsM40AsPrinted,
    /// The same with non-negative unknowns and the bias noise known.
    AlsM40Nnls,
    /// From fixed-gain filters, all innovations so far.
    AlsLong,
    /// From fixed-gain filters, block by block, with the test of fit, hold and gate.
    AlsMonitor,
    /// The same, from a Q a hundred times too large.
    AlsMonitorQX100,
    /// Q and R as they are at each instant, R diagonal as in all others; disturbed samples are left out.
    Oracle,
    /// The same with the whole R: an error of the tilt turns the heading by the tangent of the dip, and a heading that the gyros have
    /// smoothed tells it.
    OracleFullR,
}

impl AttitudeVariant {
    /// All of them.
    pub const ALL: [AttitudeVariant; 17] = [
        AttitudeVariant::Raw,
        AttitudeVariant::Datasheet,
        AttitudeVariant::DatasheetGated,
        AttitudeVariant::DatasheetPlainGate,
        AttitudeVariant::QX100,
        AttitudeVariant::MohamedSchwarzFair,
        AttitudeVariant::MohamedSchwarzROver10,
        AttitudeVariant::MohamedSchwarzR,
        AttitudeVariant::MohamedSchwarzQAndR,
        AttitudeVariant::PaperRecursion,
        AttitudeVariant::AlsM40AsPrinted,
        AttitudeVariant::AlsM40Nnls,
        AttitudeVariant::AlsLong,
        AttitudeVariant::AlsMonitor,
        AttitudeVariant::AlsMonitorQX100,
        AttitudeVariant::Oracle,
        AttitudeVariant::OracleFullR,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        use AttitudeVariant::*;
        match self {
            Raw => "raw",
            Datasheet => "datasheet",
            DatasheetGated => "datasheet_gated",
            DatasheetPlainGate => "datasheet_plain_gate",
            QX100 => "q_x100",
            MohamedSchwarzFair => "mohamed_schwarz_fair",
            MohamedSchwarzROver10 => "mohamed_schwarz_r_over_10",
            MohamedSchwarzR => "mohamed_schwarz_r",
            MohamedSchwarzQAndR => "mohamed_schwarz_q_and_r",
            PaperRecursion => "paper_recursion",
            AlsM40AsPrinted => "als_m40_as_printed",
            AlsM40Nnls => "als_m40_nnls",
            AlsLong => "als_long",
            AlsMonitor => "als_monitor",
            AlsMonitorQX100 => "als_monitor_q_x100",
            Oracle => "oracle",
            OracleFullR => "oracle_full_r",
        }
    }

    pub(super) fn gated(self) -> bool {
        use AttitudeVariant::*;
        matches!(
            self,
            DatasheetGated | DatasheetPlainGate | AlsMonitor | AlsMonitorQX100
        )
    }

    /// Whether it is told what no filter knows.
    pub(super) fn knows(self) -> bool {
        matches!(self, AttitudeVariant::Oracle | AttitudeVariant::OracleFullR)
    }

    /// Factor on the data sheet's Q at the begin.
    pub(super) fn start_factor(self) -> f64 {
        match self {
            AttitudeVariant::QX100 | AttitudeVariant::AlsMonitorQX100 => 100.0,
            _ => 1.0,
        }
    }
}
