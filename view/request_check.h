// Which requests of browsers and others are answered, and with what. No network in here: whatever a
// stranger sends comes through this function first.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace waymark::view {

// Who may ask.
struct Access {
  // Names that a request may be addressed to (Host), lower case, without port. A page of somebody
  // else's whose name suddenly leads to this computer is none of them.
  std::vector<std::string> hosts = {"localhost", "127.0.0.1", "[::1]"};
  // Asked for with everything but the page itself; empty: nobody has to have one. With a token any
  // name will do: whoever knows it was told.
  std::string token;
};

// What matters of a request.
struct RequestHead {
  std::string method;
  std::string target;
  std::string host{};           // empty: the field is missing
  std::string origin{};         // likewise
  std::string authorization{};  // likewise
  bool upgrade = false;         // to a WebSocket
};

enum class Resource { kNone, kFile, kState, kMetrics, kCalibration, kSocket };

struct Answer {
  int status = 400;  // of HTTP; 101: becomes a WebSocket
  Resource resource = Resource::kNone;
  std::string file;    // of kFile: which; one of `files`
  std::string reason;  // of what is refused, for people
};

// `files`: the page's files there are, "index.html" among them, which "/" means.
[[nodiscard]] Answer checkRequest(const RequestHead& request, const Access& access,
                                  const std::vector<std::string>& files);

// Takes as long whatever is wrong with it.
[[nodiscard]] bool sameToken(std::string_view given, std::string_view expected);

// A token is 16 to 200 letters, digits, '-' and '_'.
[[nodiscard]] bool isToken(std::string_view text);

}  // namespace waymark::view
