// Requests to the control socket, a line each. Whatever comes is a request or an error, and the
// error can be sent back.
#include "daemon/control/control_request.h"
#include "io/text/json_node.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto request = daemon::parseControlRequest(fuzz::textOf(data, size));
  if (!request) {
    fuzz::require(!request.error().message.empty(), "an error says something");
    const std::string reply = io::Json(request.error().message).dump();
    fuzz::require(reply.find('\n') == std::string::npos, "a reply is one line");
    return 0;
  }
  if (const auto* load = std::get_if<daemon::LoadMapRequest>(&*request)) {
    fuzz::require(load->file.empty() || load->file.is_absolute(), "a map's path is absolute");
  }
  return 0;
}
