//! Check of the network to a robot: the interface that its address is reached by, and the properties of it that delay or lose states.

use super::check::Check;
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::Path;

/// Name of the check.
const NAME: &str = "robot network";
/// Least speed that Franka asks of a network card, Mbit/s. States and commands take 24 Mbit/s.
const LEAST_SPEED: i64 = 100;
/// Size of the packets of Ethernet, bytes. A state of 2373 bytes takes two of them.
const ETHERNET_MTU: u64 = 1500;

/// Checks the way to this robot; `None`: no robot was named.
pub fn check(robot: Option<&str>) -> Check {
    let Some(robot) = robot else {
        return Check::good(NAME, "not looked at: `catenary doctor --robot ADDRESS` does");
    };
    let ip = match address(robot) {
        Ok(ip) => ip,
        Err(why) => return Check::bad(NAME, format!("{robot}: {why}"), "give the robot's IPv4 address, as in Desk"),
    };
    // Only an address of this machine can be bound.
    if ip.is_loopback() || UdpSocket::bind((ip, 0)).is_ok() {
        return Check::good(NAME, format!("{ip} is this machine: an emulated arm"));
    }
    let table = match std::fs::read_to_string("/proc/net/route") {
        Ok(table) => table,
        Err(e) => {
            let detail = format!("cannot be told, because /proc/net/route cannot be read: {e}");
            return Check::warning(NAME, detail, format!("see `ip route get {ip}`"));
        }
    };
    match route(&table, ip) {
        None => Check::bad(
            NAME,
            format!("there is no route to {ip}"),
            "give this machine an address in the robot's network",
        ),
        Some(route) => judge(&route, &Link::read(&Path::new("/sys/class/net").join(&route.interface))),
    }
}

/// IPv4 address of a robot, which may be given by name, and with the port of FCI.
fn address(robot: &str) -> Result<Ipv4Addr, String> {
    let with_port = if robot.contains(':') { robot.to_owned() } else { format!("{robot}:1337") };
    let all = with_port.to_socket_addrs().map_err(|e| e.to_string())?;
    let v4 = |address: SocketAddr| match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    };
    all.into_iter().find_map(v4).ok_or_else(|| "no IPv4 address".to_owned())
}

/// Way to an address.
#[derive(Debug, PartialEq)]
struct Route {
    interface: String,
    /// Router on the way.
    gateway: Option<Ipv4Addr>,
}

/// Route to an address by the kernel's table: that with the longest mask, and of these that with the least metric.
///
/// A row holds interface, destination, gateway, flags, references, uses, metric and mask. Addresses are numbers in the machine's byte order.
fn route(table: &str, ip: Ipv4Addr) -> Option<Route> {
    let rows = table.lines().skip(1).filter_map(|row| {
        let words: Vec<&str> = row.split_whitespace().collect();
        let number = |at: usize| u32::from_str_radix(words.get(at)?, 16).ok();
        let address = |at: usize| Some(u32::from_be_bytes(number(at)?.to_ne_bytes()));
        let (destination, gateway, mask) = (address(1)?, address(2)?, address(7)?);
        let metric: u32 = words.get(6)?.parse().ok()?;
        let leads_there = u32::from(ip) & mask == destination;
        let gateway = (gateway != 0).then(|| Ipv4Addr::from(gateway));
        leads_there.then(|| (mask, std::cmp::Reverse(metric), Route { interface: words[0].to_owned(), gateway }))
    });
    rows.max_by_key(|(mask, metric, _)| (*mask, *metric)).map(|(_, _, route)| route)
}

/// Properties of an interface; `None`: the system does not tell.
#[derive(Debug, Clone, PartialEq, Default)]
struct Link {
    is_wireless: bool,
    /// False for a bridge, a tunnel or the interface of a container.
    is_physical: bool,
    has_carrier: Option<bool>,
    speed_mbit_s: Option<i64>,
    duplex: Option<String>,
    mtu_bytes: Option<u64>,
    /// Setting of the power saving: `on` keeps the adapter awake, `auto` may suspend it.
    power: Option<String>,
}

impl Link {
    /// Reads the folder of an interface in /sys/class/net. The kernel refuses some files of an interface that is down.
    fn read(folder: &Path) -> Self {
        let text = |name: &str| Some(std::fs::read_to_string(folder.join(name)).ok()?.trim().to_owned());
        Self {
            is_wireless: ["wireless", "phy80211"].iter().any(|name| folder.join(name).exists()),
            is_physical: folder.join("device").exists(),
            has_carrier: text("carrier").map(|carrier| carrier == "1"),
            // -1: unknown.
            speed_mbit_s: text("speed").and_then(|speed| speed.parse().ok()).filter(|speed| *speed >= 0),
            duplex: text("duplex").filter(|duplex| duplex != "unknown"),
            mtu_bytes: text("mtu").and_then(|mtu| mtu.parse().ok()),
            power: text("device/power/control"),
        }
    }
}

/// Check of an interface by which a robot is reached.
fn judge(route: &Route, link: &Link) -> Check {
    let name = &route.interface;
    let told = |value: Option<String>, what: &str| value.unwrap_or_else(|| format!("{what} unknown"));
    let detail = [
        format!("by {name}{}", if link.is_wireless { ", wireless" } else { "" }),
        told(link.speed_mbit_s.map(|speed| format!("{speed} Mbit/s")), "speed"),
        told(link.duplex.as_ref().map(|duplex| format!("{duplex} duplex")), "duplex"),
        told(link.mtu_bytes.map(|mtu| format!("MTU {mtu}")), "MTU"),
        told(link.power.as_ref().map(|power| format!("power control {power}")), "power control"),
    ];
    let detail = detail.join(", ");
    match remedies(route, link).as_slice() {
        [] => Check::good(NAME, detail),
        found => Check::warning(NAME, detail, found.join("; ")),
    }
}

/// Remedies for what delays or loses states.
fn remedies(route: &Route, link: &Link) -> Vec<String> {
    let name = &route.interface;
    let mut found = Vec::new();
    if let Some(gateway) = route.gateway {
        found
            .push(format!("the way leads over the router {gateway}: connect this machine straight to the control box"));
    }
    if link.is_wireless {
        found.push("a wireless link loses states: use a cable".to_owned());
    } else if !link.is_physical {
        found.push(format!(
            "{name} is a bridge, a tunnel or a container's interface: run the bridge in the host's network"
        ));
    }
    if link.has_carrier == Some(false) {
        found.push("no signal: check the cable, and that the control box is on".to_owned());
    }
    if link.speed_mbit_s.is_some_and(|speed| speed < LEAST_SPEED) || link.duplex.as_deref() == Some("half") {
        found.push(format!(
            "at least {LEAST_SPEED} Mbit/s and full duplex are needed: check the cable, see `ethtool {name}`"
        ));
    }
    if link.mtu_bytes.is_some_and(|mtu| mtu < ETHERNET_MTU) {
        found.push(format!("a state takes more than two packets: sudo ip link set {name} mtu {ETHERNET_MTU}"));
    }
    if link.power.as_deref() == Some("auto") {
        found.push(format!("the adapter may sleep: echo on | sudo tee /sys/class/net/{name}/device/power/control"));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::check::Verdict::{Bad, Good, Warning};
    use super::*;

    /// A cable to the robot, a wireless way to the rest, and a second, dearer way to the robot's network.
    const TABLE: &str = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n\
        wlan0\t00000000\t0101A8C0\t0003\t0\t0\t600\t00000000\t0\t0\t0\n\
        wlan0\t0001A8C0\t00000000\t0001\t0\t0\t600\t00FFFFFF\t0\t0\t0\n\
        eth1\t000010AC\t00000000\t0001\t0\t0\t200\t00FFFFFF\t0\t0\t0\n\
        eth0\t000010AC\t00000000\t0001\t0\t0\t100\t00FFFFFF\t0\t0\t0\n";

    #[cfg(target_endian = "little")]
    #[test]
    fn the_longest_mask_and_then_the_least_metric_decide() {
        let to = |ip: [u8; 4]| route(TABLE, ip.into()).unwrap();
        assert_eq!(to([172, 16, 0, 2]), Route { interface: "eth0".to_owned(), gateway: None });
        let router = Some(Ipv4Addr::new(192, 168, 1, 1));
        assert_eq!(to([10, 0, 0, 7]), Route { interface: "wlan0".to_owned(), gateway: router });
        assert_eq!(to([192, 168, 1, 7]).gateway, None);
        assert_eq!(route("Iface\n", [172, 16, 0, 2].into()), None);
    }

    /// Interface that a lab should have.
    fn cable() -> Link {
        Link {
            is_wireless: false,
            is_physical: true,
            has_carrier: Some(true),
            speed_mbit_s: Some(1000),
            duplex: Some("full".to_owned()),
            mtu_bytes: Some(1500),
            power: Some("on".to_owned()),
        }
    }

    #[test]
    fn whatever_delays_states_has_a_remedy() {
        let straight = || Route { interface: "eth0".to_owned(), gateway: None };
        let of = |link: Link| judge(&straight(), &link);
        let good = of(cable());
        assert_eq!((good.verdict, good.remedy), (Good, None));
        assert_eq!(good.detail, "by eth0, 1000 Mbit/s, full duplex, MTU 1500, power control on");
        let cases = [
            (Link { is_wireless: true, ..cable() }, "use a cable"),
            (Link { is_physical: false, ..cable() }, "host's network"),
            (Link { has_carrier: Some(false), ..cable() }, "no signal"),
            (Link { speed_mbit_s: Some(10), ..cable() }, "100 Mbit/s"),
            (Link { duplex: Some("half".to_owned()), ..cable() }, "full duplex"),
            (Link { mtu_bytes: Some(1400), ..cable() }, "mtu 1500"),
            (Link { power: Some("auto".to_owned()), ..cable() }, "may sleep"),
        ];
        for (link, says) in cases {
            let check = of(link);
            assert!(check.verdict == Warning && check.remedy.as_ref().unwrap().contains(says), "{check:?}");
        }
        let routed = judge(&Route { gateway: Some(Ipv4Addr::new(192, 168, 1, 1)), ..straight() }, &cable());
        assert!(routed.remedy.unwrap().contains("192.168.1.1"));
    }

    #[test]
    fn properties_that_the_system_does_not_tell_are_unknown() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mtu"), "1500\n").unwrap();
        std::fs::write(folder.path().join("speed"), "-1\n").unwrap();
        std::fs::create_dir(folder.path().join("device")).unwrap();
        let link = Link::read(folder.path());
        assert_eq!(link, Link { is_physical: true, mtu_bytes: Some(1500), ..Link::default() });
        let check = judge(&Route { interface: "eth0".to_owned(), gateway: None }, &link);
        assert!(check.detail.contains("speed unknown") && check.verdict == Good, "{check:?}");
        std::fs::create_dir(folder.path().join("wireless")).unwrap();
        assert!(Link::read(folder.path()).is_wireless);
    }

    #[test]
    fn this_machine_is_an_emulated_arm_and_no_name_is_a_bad_one() {
        assert_eq!(check(Some("127.0.0.1")).verdict, Good);
        assert!(check(Some("127.45.0.1:1337")).detail.contains("an emulated arm"));
        assert_eq!(check(Some("::1:1337:x")).verdict, Bad);
        assert!(check(None).detail.contains("--robot"));
    }
}
