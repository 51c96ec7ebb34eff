// YAML as other programs write it, read with the strictness of our own JSON files.
#pragma once

#include <string>

#include "base/result.h"
#include "io/json_node.h"

namespace waymark::io {

// What OpenCV's parser makes of it, with or without "%YAML:1.0" at its head: maps, lists, numbers
// and text; true and false are text. The error names the file.
[[nodiscard]] Result<Json> parseYaml(const std::string& text, const std::string& file);

}  // namespace waymark::io
