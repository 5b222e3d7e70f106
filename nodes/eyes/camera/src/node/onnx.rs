//! YOLOv8-seg networks through the ONNX Runtime, a shared library that is loaded when it is needed.

use crate::Error;
use crate::yolo::{YoloNetwork, YoloOutput, YoloParams};
use anyhow::{Context, Result, bail};
use ort::environment::Environment;
use ort::session::Session;
use ort::value::{TensorRef, ValueType};

/// Side of the input of a network that takes any size, in pixels: the default of `ultralytics`.
const USUAL_PX: usize = 640;

/// Network in an ONNX file.
pub struct OnnxNetwork {
    session: Session,
    _environment: Environment,
    input: String,
    input_px: [usize; 2],
    boxes: Vec<f32>,
    boxes_shape: [usize; 2],
    masks: Vec<f32>,
    masks_px: [usize; 2],
}

impl OnnxNetwork {
    /// Loads the runtime and the network.
    ///
    /// # Errors
    /// A file that is missing, no library or no network; a network that is no YOLOv8-seg one.
    pub fn load(params: &YoloParams) -> Result<Self> {
        let (network, runtime) = (&params.network, &params.runtime);
        if network.as_os_str().is_empty() {
            bail!("parameter yolo.network: expected the path of an ONNX file for the segmenter `yolo`, got none");
        }
        let environment = ort::environment::init_from(runtime).map_err(|error| anyhow::anyhow!("{error}"));
        let environment = environment.with_context(|| {
            format!("parameter yolo.runtime: expected the ONNX Runtime's shared library, got {}", runtime.display())
        })?;
        let environment = environment.with_name("catenary").with_telemetry(false).build()?;
        // The other cores belong to the rest of the graph.
        let builder = Session::builder(&environment)?.with_intra_threads(1);
        let mut builder = builder.map_err(|error| anyhow::anyhow!("{error}"))?;
        if !network.is_file() {
            bail!("parameter yolo.network: expected an ONNX file, found none at {}", network.display());
        }
        let session = builder.commit_from_file(network);
        let session =
            session.with_context(|| format!("parameter yolo.network: {}: expected an ONNX file", network.display()))?;
        let (input, input_px) =
            input_of(&session).with_context(|| format!("parameter yolo.network: {}", network.display()))?;
        if session.outputs().len() < 2 {
            let (name, got) = (network.display(), session.outputs().len());
            bail!(
                "parameter yolo.network: {name}: expected two results, boxes and masks (a `-seg` network), got {got}"
            );
        }
        Ok(Self {
            session,
            _environment: environment,
            input,
            input_px,
            boxes: Vec::new(),
            boxes_shape: [0; 2],
            masks: Vec::new(),
            masks_px: [0; 2],
        })
    }
}

/// Name, width and height of the network's input.
fn input_of(session: &Session) -> Result<(String, [usize; 2])> {
    let [input] = session.inputs() else {
        bail!("expected one input, got {}", session.inputs().len());
    };
    let ValueType::Tensor { shape, .. } = input.dtype() else {
        bail!("expected an input of numbers, got {:?}", input.dtype());
    };
    let size = |n: i64| if n > 0 { n as usize } else { USUAL_PX };
    match **shape {
        [_, 3, height, width] => Ok((input.name().to_owned(), [size(width), size(height)])),
        _ => bail!("expected an input of 1 x 3 x height x width numbers, got {shape:?}"),
    }
}

impl YoloNetwork for OnnxNetwork {
    fn input_px(&self) -> [usize; 2] {
        self.input_px
    }

    fn run(&mut self, planes: &[f32]) -> Result<YoloOutput<'_>, Error> {
        let fault =
            |error: ort::Error| Error::Network { expected: "a network that runs".to_owned(), got: error.to_string() };
        let [width, height] = self.input_px;
        let input = TensorRef::from_array_view(([1_usize, 3, height, width], planes)).map_err(fault)?;
        let outputs = self.session.run(ort::inputs![self.input.as_str() => input]).map_err(fault)?;
        let (shape, boxes) = outputs[0].try_extract_tensor::<f32>().map_err(fault)?;
        let [_, rows, anchors] = **shape else { return Err(other("1 x rows x anchors", shape)) };
        let (shape, masks) = outputs[1].try_extract_tensor::<f32>().map_err(fault)?;
        let [_, _, mask_height, mask_width] = **shape else { return Err(other("1 x 32 x height x width", shape)) };
        self.boxes_shape = [rows, anchors].map(|n| n as usize);
        self.masks_px = [mask_width, mask_height].map(|n| n as usize);
        // The runtime owns its results until the next run.
        self.boxes.clear();
        self.boxes.extend_from_slice(boxes);
        self.masks.clear();
        self.masks.extend_from_slice(masks);
        let [rows, anchors] = self.boxes_shape;
        Ok(YoloOutput { rows, anchors, boxes: &self.boxes, masks: &self.masks, masks_px: self.masks_px })
    }
}

fn other(expected: &str, shape: &ort::value::Shape) -> Error {
    Error::Network { expected: format!("a result of {expected} numbers"), got: shape.to_string() }
}
