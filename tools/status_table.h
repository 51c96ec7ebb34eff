// What a daemon's status says, for people.
#pragma once

#include <string>

#include "io/text/json_node.h"

namespace waymark::tools {

// `status`: the daemon's reply. One line for each thing somebody may want to know; what a daemon of
// another version does not say is left out.
[[nodiscard]] std::string statusTable(const io::Json& status);

}  // namespace waymark::tools
