// YAML as other programs write it, read with the strictness of our own JSON files.
#pragma once

#include <string>

#include "base/result.h"
#include "io/text/json_node.h"

namespace waymark::io {

// The first document of the text: maps, lists, numbers and text. Quoted numbers are text; so are
// true, false and what is not finite. Tags are passed over. Text that begins with "%YAML:1.0" is in
// OpenCV's dialect, which other parsers do not take. The error is one line that names the file, and
// the line where that is known.
[[nodiscard]] Result<Json> parseYaml(const std::string& text, const std::string& file);

}  // namespace waymark::io
