fn main() {
    println!("{:?}", rigless::time::VirtualNanos(0));
}
