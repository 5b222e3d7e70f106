//! Tests of the generator: syntax that no interface of this crate uses, against hashes that rosidl computed, and broken files.

#[path = "../generate/describe.rs"]
mod describe;
#[path = "../generate/parse.rs"]
mod parse;

use describe::Catalogue;
use parse::{Base, Count, Section, sections};

fn catalogue(messages: &[(&str, &str, &str)]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    for (package, name, text) in messages {
        catalogue.message(package, "msg", name, &section(text, package));
    }
    catalogue
}

fn section(text: &str, package: &str) -> Section {
    let mut all = sections(text, package).expect("the text of the test is well formed");
    assert_eq!(all.len(), 1);
    all.remove(0)
}

#[test]
fn bounded_sequences_have_the_hash_of_rosidl() {
    let messages = [
        ("geometry_msgs", "Point32", "float32 x\nfloat32 y\nfloat32 z\n"),
        ("geometry_msgs", "Polygon", "Point32[] points\n"),
        (
            "shape_msgs",
            "SolidPrimitive",
            "uint8 BOX=1\nuint8 type\nfloat64[<=3] dimensions # no more\ngeometry_msgs/Polygon polygon\n",
        ),
    ];
    let hash = catalogue(&messages).hash("shape_msgs/msg/SolidPrimitive").unwrap();
    assert_eq!(hash, "RIHS01_2802a15190aadc3f496584df4b0b4c5824d8a0b31aaef839faa75bc34dda38ac");
}

#[test]
fn bounded_strings_and_defaults_have_the_hash_of_rosidl() {
    let text =
        "uint8 type_id 0\nuint64 capacity 0\nuint64 string_capacity 0\nstring<=255 nested_type_name # when nested\n";
    let hash = catalogue(&[("type_description_interfaces", "FieldType", text)]);
    let hash = hash.hash("type_description_interfaces/msg/FieldType").unwrap();
    assert_eq!(hash, "RIHS01_a70b6dd919645a03a3586f7f821defbc886ea3e531a1d95cc0f380a3973ccaa6");
}

#[test]
fn constants_defaults_and_comments_are_separated() {
    let text = "# Of all.\n\n# Of the constant.\nstring NAME=\"a b\" # beside it\nint32 LOW = -5\nfloat64 w 1 # unit\nstring<=4[<=2] tags [\"x=1\"]\n";
    let section = section(text, "p");
    assert_eq!(section.comment, ["Of all."]);
    let constants: Vec<_> = section.constants.iter().map(|c| (&c.type_name[..], &c.name[..], &c.value[..])).collect();
    assert_eq!(constants, [("string", "NAME", "a b"), ("int32", "LOW", "-5")]);
    assert_eq!(section.constants[0].comment, ["Of the constant.", "beside it"]);
    assert_eq!((section.fields[0].name.as_str(), &section.fields[0].comment[..]), ("w", &["unit".to_owned()][..]));
    let tags = &section.fields[1];
    assert_eq!((tags.string_capacity, tags.count), (4, Count::Bounded(2)));
    assert_eq!(tags.base, Base::Primitive("string".into()));
}

#[test]
fn broken_lines_are_named() {
    assert_eq!(sections("float64 x\nfloat64\n", "p").unwrap_err(), "line 2: expected TYPE NAME: `float64`");
    assert!(sections("float64[x] y\n", "p").unwrap_err().contains("expected a size, got `x`"));
}

#[test]
fn an_unknown_type_is_named() {
    let catalogue = catalogue(&[("p", "Outer", "Inner inner\n")]);
    assert_eq!(catalogue.hash("p/msg/Outer").unwrap_err(), "no definition of `p/msg/Inner`");
}

#[test]
fn services_and_actions_have_the_types_that_rosidl_derives() {
    let mut catalogue = catalogue(&[
        ("builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n"),
        ("service_msgs", "ServiceEventInfo", include_str!("../ros_interfaces/service_msgs/msg/ServiceEventInfo.msg")),
        ("unique_identifier_msgs", "UUID", "uint8[16] uuid\n"),
    ]);
    let (request, response) =
        (section("bool data\n", "std_srvs"), section("bool success\nstring message\n", "std_srvs"));
    catalogue.service("std_srvs", "srv", "SetBool", request.fields.clone(), response.fields.clone());
    let hash = catalogue.hash("std_srvs/srv/SetBool").expect("every type is there");
    assert_eq!(hash, "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a");
    catalogue.action("p", "Go", &request, &response, &section("float64 done\n", "p"));
    let references = catalogue.references("p/action/Go").expect("every type is there");
    let derived: Vec<&str> = references.iter().filter_map(|r| r.strip_prefix("p/action/Go_")).collect();
    let expected = [
        "Feedback",
        "FeedbackMessage",
        "GetResult",
        "GetResult_Event",
        "GetResult_Request",
        "GetResult_Response",
        "Goal",
        "Result",
        "SendGoal",
        "SendGoal_Event",
        "SendGoal_Request",
        "SendGoal_Response",
    ];
    assert_eq!(derived, expected);
}

#[test]
fn defaults_are_written_as_rosidl_writes_them() {
    let text = "float64 w 1\nfloat32 x 0.5\nbool a true\nbool b 0\nint8 n -2\nstring s\n";
    let defaults: Vec<String> = section(text, "p").fields.into_iter().map(|field| field.default_value).collect();
    assert_eq!(defaults, ["1.0", "0.5", "True", "False", "-2", ""]);
}

#[test]
fn every_structure_has_a_row_of_its_fields() {
    let rows = catalogue(&[("p", "Inner", "float64[3] x\n"), ("p", "Outer", "Inner[<=2] inner\nint8 n -2\n")]).rows();
    let rows: Vec<String> = rows.unwrap().lines().map(str::to_owned).collect();
    assert_eq!(rows.len(), 2);
    assert!(
        rows[0].contains("type_name: \"p/msg/Inner\"") && rows[0].contains("type_id: 59, capacity: 3"),
        "{}",
        rows[0]
    );
    let outer = "type_id: 97, capacity: 2, string_capacity: 0, nested_type_name: \"p/msg/Inner\"";
    assert!(rows[1].contains(outer) && rows[1].contains("default_value: \"-2\""), "{}", rows[1]);
}
