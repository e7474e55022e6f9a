//! The protocols: a line for each. Everything that exists for each protocol is made from this table: this package, the program
//! `jetlink`, and the judges of random worlds.

/// Calls a macro with each protocol: its variant, its module, the configuration of its simulated ECU, the ECU, and the command in its
/// control frames. The text is that of `jetlink decode --help`.
#[macro_export]
macro_rules! protocols {
    ($make:ident) => {
        $make! {
            /// AMT serial control: Mercury, Pegasus, Olympus, Titan, Nike, Lynx, Orion.
            Amt amt($crate::amt::AmtConfig, $crate::amt::AmtEcu, $crate::amt::AmtCommand);
            /// ZK-Protocol.
            Zk zk($crate::zk::ZkConfig, $crate::zk::ZkEcu, $crate::zk::ZkCommand);
            /// The toy protocol.
            Toy toy($crate::toy::ToyConfig, $crate::toy::ToyEcu, $crate::toy::ToyCommand);
        }
    };
}
