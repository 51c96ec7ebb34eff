// What strangers send to waymark-view: bytes of HTTP, and commands of a page. Nothing is answered
// that should not be, with a token and without.
#include <algorithm>
#include <string>
#include <vector>

#include <boost/asio/buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include "tests/fuzz/fuzz_target.h"
#include "view/control_link.h"
#include "view/request_check.h"

using namespace waymark;

namespace {

namespace http = boost::beast::http;

const std::vector<std::string> kFiles = {"index.html", "view.js"};
const std::string kToken = "0123456789abcdef";

void check(const view::RequestHead& head, const view::Access& access) {
  const view::Answer answer = view::checkRequest(head, access, kFiles);
  using view::Resource;
  fuzz::require((answer.resource == Resource::kNone) == (answer.status >= 400),
                "what is refused is nothing");
  if (answer.resource == Resource::kNone) {
    fuzz::require(!answer.reason.empty(), "a refusal says why");
    return;
  }
  fuzz::require(head.method == "GET" || head.method == "HEAD", "only reading");
  if (answer.resource == Resource::kFile) {
    fuzz::require(std::ranges::find(kFiles, answer.file) != kFiles.end(), "a file there is");
    return;
  }
  const bool told =
      head.target.find(kToken) != std::string::npos || head.authorization == "Bearer " + kToken;
  fuzz::require(access.token.empty() || told, "a secret is for who knows the token");
  if (answer.resource != Resource::kSocket || head.origin.empty()) return;
  fuzz::require(head.origin.size() > head.host.size() + 6, "a socket is for our own page");
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)view::requestOf(fuzz::textOf(data, size));
  http::request_parser<http::string_body> parser;
  parser.header_limit(8192);
  parser.body_limit(1024);
  parser.eager(true);
  boost::beast::error_code failed;
  std::size_t used = 0;
  while (used < size && !parser.is_done() && !failed) {
    const std::size_t more = parser.put(boost::asio::buffer(data + used, size - used), failed);
    if (more == 0) break;
    used += more;
  }
  if (failed || !parser.is_done()) return 0;
  const auto& request = parser.get();
  const auto field = [&](http::field name) { return std::string(request[name]); };
  const view::RequestHead head{.method = std::string(request.method_string()),
                               .target = std::string(request.target()),
                               .host = field(http::field::host),
                               .origin = field(http::field::origin),
                               .authorization = field(http::field::authorization),
                               .upgrade = boost::beast::websocket::is_upgrade(request)};
  check(head, {});
  view::Access access;
  access.token = kToken;
  check(head, access);
  return 0;
}
