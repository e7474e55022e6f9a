//! The simulated protocols: a line for each.

/// Calls a macro with each protocol: its variant in [`any`](crate::any) and [`control`](crate::control), the configuration of its
/// ECU, the ECU, and the command in its control frames.
macro_rules! protocols {
    ($make:ident) => {
        $make! {
            /// AMT.
            Amt($crate::amt::AmtConfig, $crate::amt::AmtEcu, $crate::amt::AmtCommand);
            /// ZK.
            Zk($crate::zk::ZkConfig, $crate::zk::ZkEcu, $crate::zk::ZkCommand);
        }
    };
}
pub(crate) use protocols;
