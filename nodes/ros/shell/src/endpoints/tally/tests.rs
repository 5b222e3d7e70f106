use super::*;

const IMAGES: Names = Names { one: "image", many: "images" };

fn at(second: f64) -> Moment {
    let uptime = Duration::from_secs_f64(second);
    Moment { uptime, clock: Time::from_nanos(1_000_000_000_000) + uptime }
}

fn encoding() -> Flaw {
    Flaw::new("encoding", "encoding: expected rgb8, got bgr8")
}

fn one_publisher() -> Publishers {
    Publishers { fitting: 1, unheard: Vec::new() }
}

/// Runs a second with `used` and `dropped` images, and returns the worst health and the messages.
fn second(tally: &mut Tally, number: u32, used: u32, dropped: u32) -> (Health, String) {
    let end = f64::from(number) + 1.0;
    (0..used).for_each(|_| tally.message(at(end), None));
    (0..dropped).for_each(|_| tally.message(at(end), Some(&encoding())));
    worst(&tally.report("/image", &one_publisher(), at(end)))
}

fn worst(found: &Findings) -> (Health, String) {
    let health = found.problems.iter().map(|(health, _)| *health).max().unwrap_or(Health::Ok);
    (health, found.problems.iter().map(|(_, text)| &text[..]).collect::<Vec<_>>().join("; "))
}

fn needed() -> Tally {
    let mut tally = Tally::new(Some(IMAGES), Duration::from_millis(500), at(0.0));
    tally.need(true, at(0.0));
    tally
}

#[test]
fn the_share_of_dropped_messages_decides_the_health() {
    // Used and dropped messages in a second, need of the topic, and the expected health.
    let table = [
        (60, 0, true, Health::Ok),
        (300, 1, true, Health::Ok),
        (60, 1, true, Health::Warn),
        (1, 59, true, Health::Warn),
        (0, 60, true, Health::Error),
        (0, 1, true, Health::Error),
        (0, 60, false, Health::Warn),
        (0, 0, false, Health::Ok),
        (60, 0, false, Health::Ok),
    ];
    for (used, dropped, is_needed, expected) in table {
        let mut tally = Tally::new(Some(IMAGES), Duration::from_millis(500), at(0.0));
        tally.need(is_needed, at(0.0));
        let (health, text) = second(&mut tally, 0, used, dropped);
        assert_eq!(health, expected, "{used} used, {dropped} dropped, needed: {is_needed}: {text}");
        assert_eq!(text.contains("expected rgb8, got bgr8"), expected != Health::Ok, "{text}");
    }
}

#[test]
fn health_recovers_when_the_window_is_clean_again() {
    let mut tally = needed();
    assert_eq!(second(&mut tally, 0, 0, 60).0, Health::Error);
    let levels: Vec<_> = (1..6).map(|number| second(&mut tally, number, 60, 0).0).collect();
    assert_eq!(levels, [Health::Warn, Health::Warn, Health::Warn, Health::Warn, Health::Ok]);
}

#[test]
fn silence_is_an_error_only_while_the_topic_is_needed() {
    let mut tally = needed();
    assert_eq!(second(&mut tally, 0, 0, 0).0, Health::Ok, "discovery takes its time");
    let (health, text) = second(&mut tally, 5, 0, 0);
    assert_eq!((health, &text[..]), (Health::Error, "no images on /image yet: its publisher is silent"));
    assert_eq!(second(&mut tally, 6, 1, 0).0, Health::Ok);
    let (health, text) = second(&mut tally, 9, 0, 0);
    assert_eq!((health, &text[..]), (Health::Error, "no images on /image for 3.0 s: its publisher is silent"));
    tally.need(false, at(10.0));
    assert_eq!(second(&mut tally, 10, 0, 0).0, Health::Ok);
    tally.need(true, at(20.9));
    assert_eq!(second(&mut tally, 20, 0, 0).0, Health::Ok, "the need began 0.1 s ago");
    assert_eq!(second(&mut tally, 21, 0, 0).0, Health::Error);
}

#[test]
fn a_pause_of_either_clock_is_no_silence() {
    let mut tally = needed();
    tally.message(at(1.0), None);
    let paused = Moment { uptime: Duration::from_secs(60), clock: at(1.0).clock };
    assert_eq!(worst(&tally.report("/image", &one_publisher(), paused)).0, Health::Ok);
    let fast = Moment { uptime: Duration::from_millis(1100), clock: at(60.0).clock };
    assert_eq!(worst(&tally.report("/image", &one_publisher(), fast)).0, Health::Ok);
}

#[test]
fn publishers_explain_a_silence() {
    let unheard = || vec!["it offers best effort, and reliable is asked for".to_owned()];
    let table = [
        (Publishers::default(), "nobody publishes it"),
        (Publishers { fitting: 0, unheard: unheard() }, "its publishers do not fit"),
        (Publishers { fitting: 3, unheard: Vec::new() }, "its 3 publishers are silent"),
    ];
    for (publishers, expected) in table {
        let (health, text) = worst(&needed().report("/image", &publishers, at(9.0)));
        assert!(health == Health::Error && text.ends_with(expected), "{text}");
        assert_eq!(text.contains("it offers best effort"), !publishers.unheard.is_empty(), "{text}");
    }
    let mut unnamed = Tally::new(None, Duration::ZERO, at(0.0));
    let found = unnamed.report("/image", &Publishers { fitting: 1, unheard: unheard() }, at(9.0));
    assert_eq!((worst(&found).0, found.values), (Health::Warn, Vec::new()));
}

#[test]
fn doubtful_messages_are_used_with_a_warning() {
    let mut tally = needed();
    for _ in 0..60 {
        tally.message(at(1.0), None);
        tally.doubt(&Flaw::new("zero stamp", "the stamp is zero"));
    }
    let found = tally.report("/image", &one_publisher(), at(1.0));
    assert_eq!(worst(&found), (Health::Warn, "60 of 60 images are doubtful: the stamp is zero".to_owned()));
    let value = |key: &str| found.values.iter().find(|(name, _)| name == key).map(|(_, value)| &value[..]);
    assert_eq!(value("image_rate_hz"), Some("60.0"));
    assert_eq!((value("images_received"), value("images_dropped")), (Some("60"), Some("0")));
    assert_eq!(value("images_doubtful_for_zero_stamp"), Some("60"));
}

#[test]
fn the_most_frequent_reasons_are_named() {
    let mut tally = needed();
    for (kind, count) in [("size", 2), ("encoding", 9), ("step", 5)] {
        (0..count).for_each(|_| tally.message(at(1.0), Some(&Flaw::new(kind, format!("bad {kind}")))));
    }
    let (_, text) = worst(&tally.report("/image", &one_publisher(), at(1.0)));
    assert_eq!(text, "all 16 images of the last 5 s were dropped: bad encoding, and bad step");
}
