//! The ECU protocols of the tools: a line for each.

/// Calls a macro with each protocol: its variant in `sim::any`, and its module in `telemetry/`, `rig/engines/` and `rig/audit/`.
macro_rules! protocols {
    ($make:ident) => {
        $make! {
            /// AMT serial control: Mercury, Pegasus, Olympus, Titan, Nike, Lynx, Orion.
            Amt amt;
            /// ZK-Protocol.
            Zk zk;
        }
    };
}
pub(crate) use protocols;
