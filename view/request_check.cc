#include "view/request_check.h"

#include <algorithm>
#include <cctype>
#include <cstddef>

namespace waymark::view {
namespace {

std::string lowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower;
}

// "robot:8787" is "robot", "[::1]:8787" is "[::1]".
std::string_view withoutPort(std::string_view host) {
  const std::size_t bracket = host.find(']');
  const std::size_t colon = host.find(':', bracket == host.npos ? 0 : bracket);
  return host.substr(0, colon);
}

bool isKnownHost(const std::string& host, const Access& access) {
  if (!access.token.empty()) return !host.empty();
  const std::string name = lowerCase(withoutPort(host));
  return std::ranges::find(access.hosts, name) != access.hosts.end();
}

// The page that opens a WebSocket must be ours. Programs that are no browsers say nothing.
bool isOwnOrigin(const RequestHead& request) {
  if (request.origin.empty()) return true;
  const std::string origin = lowerCase(request.origin);
  const std::string host = lowerCase(request.host);
  return origin == "http://" + host || origin == "https://" + host;
}

struct Target {
  std::string_view path;
  std::string_view token;
};

// Of "/ws?token=abc&more".
Target parseTarget(std::string_view target) {
  const std::size_t question = target.find('?');
  Target parsed{target.substr(0, question), {}};
  std::string_view query = question == target.npos ? "" : target.substr(question + 1);
  while (!query.empty()) {
    const std::size_t end = query.find('&');
    const std::string_view field = query.substr(0, end);
    constexpr std::string_view kToken = "token=";
    if (field.starts_with(kToken)) parsed.token = field.substr(kToken.size());
    query = end == query.npos ? "" : query.substr(end + 1);
  }
  return parsed;
}

std::string_view bearerToken(std::string_view authorization) {
  constexpr std::string_view kBearer = "Bearer ";
  return authorization.starts_with(kBearer) ? authorization.substr(kBearer.size()) : "";
}

bool hasToken(const RequestHead& request, const Target& target, const Access& access) {
  if (access.token.empty()) return true;
  return sameToken(target.token, access.token) ||
         sameToken(bearerToken(request.authorization), access.token);
}

Answer refuse(int status, std::string reason) { return {status, Resource::kNone, "", reason}; }

}  // namespace

bool isToken(std::string_view text) {
  constexpr std::size_t kLeast = 16;
  constexpr std::size_t kMost = 200;
  return text.size() >= kLeast && text.size() <= kMost &&
         std::ranges::all_of(
             text, [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; });
}

bool sameToken(std::string_view given, std::string_view expected) {
  unsigned difference = given.size() == expected.size() ? 0 : 1;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const unsigned char of_given = i < given.size() ? static_cast<unsigned char>(given[i]) : 0;
    difference |= of_given ^ static_cast<unsigned char>(expected[i]);
  }
  return difference == 0 && !expected.empty();
}

Answer checkRequest(const RequestHead& request, const Access& access,
                    const std::vector<std::string>& files) {
  if (!isKnownHost(request.host, access)) return refuse(421, "this is not the host asked for");
  if (request.method != "GET" && request.method != "HEAD") return refuse(405, "only GET and HEAD");
  const Target target = parseTarget(request.target);
  const std::string file = target.path == "/"
                               ? "index.html"
                               : std::string(target.path.substr(target.path.empty() ? 0 : 1));
  if (!request.upgrade && target.path.starts_with('/') &&
      std::ranges::find(files, file) != files.end()) {
    return {200, Resource::kFile, file, ""};  // knows nothing that is a secret
  }
  if (!hasToken(request, target, access)) return refuse(401, "a token is needed");
  if (target.path == "/ws") {
    if (!request.upgrade || request.method != "GET") return refuse(426, "this is a WebSocket");
    if (!isOwnOrigin(request)) return refuse(403, "another page's request");
    return {101, Resource::kSocket, "", ""};
  }
  if (request.upgrade) return refuse(400, "this is no WebSocket");
  if (target.path == "/state.json") return {200, Resource::kState, "", ""};
  if (target.path == "/metrics") return {200, Resource::kMetrics, "", ""};
  if (target.path == "/calib.yml") return {200, Resource::kCalibration, "", ""};
  return refuse(404, "there is no such page");
}

}  // namespace waymark::view
