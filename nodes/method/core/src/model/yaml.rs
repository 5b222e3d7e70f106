//! Reading and writing of model files.

use super::outline::Node;
use super::{Model, ModelError, check};

impl Model {
    /// Reads and checks the text of a model file.
    ///
    /// # Errors
    /// [`ModelError`] with line and field: another version, no model, or values that make no sense.
    pub fn from_yaml(text: &str) -> Result<Self, ModelError> {
        let outline = Node::of(text);
        // The version comes first: a newer format may have fields that this reader would call unknown.
        check::version(outline.as_ref())?;
        // The error carries line and field; a snippet of the text would repeat them over several lines.
        let options = serde_saphyr::options! { with_snippet: false };
        let read = serde_saphyr::from_str_with_options(text, options);
        let model: Model = read.map_err(|e| ModelError::from_yaml(&e, text, outline.as_ref()))?;
        model.check().map_err(|e| e.in_text(text))?;
        Ok(model)
    }

    /// Writes the model as the text of a file. Reading it gives an equal model, bit by bit.
    ///
    /// # Errors
    /// [`ModelError`] if YAML cannot hold a value.
    pub fn to_yaml(&self) -> Result<String, ModelError> {
        serde_saphyr::to_string(self).map_err(|e| ModelError::text("", e))
    }
}
