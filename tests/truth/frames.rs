//! MAVLink frames as documented, written and read without the package that is judged.

/// Who sends a frame: system and component.
pub type Sender = (u8, u8);

/// How a frame is written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Dress {
    V1,
    V2,
}

/// Number, checksum seed and payload of a message, its fields in wire order.
#[derive(Clone, PartialEq, Debug)]
pub struct Message {
    id: u32,
    seed: u8,
    payload: Vec<u8>,
    /// Length without extensions, which is what version 1 carries.
    short: usize,
}

fn message(id: u32, seed: u8, short: usize, fields: &[&[u8]]) -> Message {
    Message { id, seed, payload: fields.concat(), short }
}

/// `HEARTBEAT`.
pub fn heartbeat(mavtype: u8, autopilot: u8, base_mode: u8, custom_mode: u32) -> Message {
    message(0, 50, 9, &[&custom_mode.to_le_bytes(), &[mavtype, autopilot, base_mode, 4, 3]])
}

/// `SERVO_OUTPUT_RAW` of outputs 1 to 16 (port 0) or 17 to 32 (port 1).
pub fn outputs(time_usec: u32, port: u8, pulses: &[u16; 16]) -> Message {
    let pulses: Vec<u8> = pulses.iter().flat_map(|pulse| pulse.to_le_bytes()).collect();
    let (first, others) = pulses.split_at(16);
    message(36, 222, 21, &[&time_usec.to_le_bytes(), first, &[port], others])
}

fn floats(params: &[f32]) -> Vec<u8> {
    params.iter().flat_map(|param| param.to_le_bytes()).collect()
}

/// `COMMAND_LONG`.
pub fn command_long(to: Sender, command: u16, confirmation: u8, params: [f32; 7]) -> Message {
    message(76, 152, 33, &[&floats(&params), &command.to_le_bytes(), &[to.0, to.1, confirmation]])
}

/// `COMMAND_INT`, which has no confirmation.
pub fn command_int(to: Sender, command: u16, params: [f32; 4]) -> Message {
    message(75, 158, 35, &[&floats(&params), &[0; 12], &command.to_le_bytes(), &[to.0, to.1, 0, 0, 0]])
}

/// `COMMAND_CANCEL`.
pub fn command_cancel(to: Sender, command: u16) -> Message {
    message(80, 14, 4, &[&command.to_le_bytes(), &[to.0, to.1]])
}

fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF_u16, |sum, byte| {
        let low = *byte ^ sum.to_le_bytes()[0];
        let low = low ^ low << 4;
        sum >> 8 ^ u16::from(low) << 8 ^ u16::from(low) << 3 ^ u16::from(low >> 4)
    })
}

/// A whole frame.
pub fn frame(dress: Dress, from: Sender, sequence: u8, message: &Message) -> Vec<u8> {
    let Message { id, seed, payload, short } = message;
    let (start, header, payload) = match dress {
        Dress::V1 => {
            let payload = &payload[..*short];
            (0xFE, vec![payload.len() as u8, sequence, from.0, from.1, *id as u8], payload)
        }
        Dress::V2 => {
            let length = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
            let [low, mid, high, _] = id.to_le_bytes();
            (0xFD, vec![length as u8, 0, 0, sequence, from.0, from.1, low, mid, high], &payload[..length])
        }
    };
    let body = [header.as_slice(), payload].concat();
    let sum = checksum(&[body.as_slice(), &[*seed]].concat());
    [&[start], body.as_slice(), &sum.to_le_bytes()].concat()
}

/// An answer to a command: the component that gives it, the command and its result.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ack {
    pub component: u8,
    pub command: u16,
    pub result: u8,
}

/// The answers in consecutive whole frames of version 2.
pub fn acks(mut bytes: &[u8]) -> Vec<Ack> {
    let mut acks = Vec::new();
    while let [0xFD, length, signed, _, _, _, component, low, mid, high, rest @ ..] = bytes {
        let payload = rest.get(..usize::from(*length)).unwrap_or_default();
        let at = |i: usize| payload.get(i).copied().unwrap_or(0);
        if [*low, *mid, *high] == [77, 0, 0] {
            let command = u16::from_le_bytes([at(0), at(1)]);
            acks.push(Ack { component: *component, command, result: at(2) });
        }
        let whole = usize::from(*length) + 2 + if *signed == 1 { 13 } else { 0 };
        bytes = rest.get(whole..).unwrap_or_default();
    }
    assert!(bytes.is_empty(), "what the node sends is frames of version 2: {bytes:02X?}");
    acks
}

/// Known answers of pymavlink 2.4.50; `mavlink/src/frame.rs` says how they were made.
#[test]
fn a_heartbeat_is_as_another_implementation_writes_it() {
    let message = heartbeat(0, 8, 1, 0x0102_0304);
    let second = [
        0xFD, 0x09, 0x00, 0x00, 0x05, 0x07, 0x19, 0x00, 0x00, 0x00, 0x04, 0x03, 0x02, 0x01, 0x00, 0x08, 0x01,
        0x04, 0x03, 0x41, 0x51,
    ];
    let first = [
        0xFE, 0x09, 0x05, 0x07, 0x19, 0x00, 0x04, 0x03, 0x02, 0x01, 0x00, 0x08, 0x01, 0x04, 0x03, 0x79, 0x3A,
    ];
    assert_eq!(frame(Dress::V2, (7, 25), 5, &message), second);
    assert_eq!(frame(Dress::V1, (7, 25), 5, &message), first);
}
