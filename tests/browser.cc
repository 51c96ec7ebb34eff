#include "tests/browser.h"

#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/core/detail/base64.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include "tests/process.h"

namespace waymark::testing {
namespace {

namespace beast = boost::beast;
namespace fs = std::filesystem;
using boost::asio::ip::tcp;

tcp::endpoint local(int port) {
  return {boost::asio::ip::address_v4::loopback(), static_cast<unsigned short>(port)};
}

// The first line of this file is the port.
int debuggingPort(const fs::path& profile) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (std::chrono::steady_clock::now() < until) {
    std::ifstream file(profile / "DevToolsActivePort");
    int port = 0;
    std::string target;
    if (file >> port >> target) return port;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return 0;
}

// "/devtools/page/..." of the page that is open.
std::string pageTarget(int port) {
  boost::asio::io_context io;
  beast::tcp_stream stream(io);
  stream.connect(local(port));
  beast::http::request<beast::http::empty_body> request(beast::http::verb::get, "/json/list", 11);
  request.set(beast::http::field::host, "127.0.0.1");
  beast::http::write(stream, request);
  beast::flat_buffer buffer;
  beast::http::response<beast::http::string_body> response;
  beast::http::read(stream, buffer, response);
  for (const auto& target : nlohmann::json::parse(response.body())) {
    if (target["type"] != "page") continue;
    const std::string url = target["webSocketDebuggerUrl"];
    return url.substr(url.find('/', 5 + 1));  // behind ws://HOST
  }
  return {};
}

}  // namespace

struct Browser::Connection {
  std::unique_ptr<Process> process;
  boost::asio::io_context io;
  beast::websocket::stream<tcp::socket> socket{io};
  int calls = 0;
};

Browser::Browser() : connection_(std::make_unique<Connection>()) {}

Browser::~Browser() {
  if (connection_->process) {
    connection_->process->signal(SIGTERM);
    (void)connection_->process->wait(std::chrono::milliseconds(10'000));
  }
}

std::unique_ptr<Browser> Browser::start(const fs::path& directory) {
  if (!fs::exists("/usr/bin/chromium")) return nullptr;
  std::unique_ptr<Browser> browser(new Browser);
  const fs::path profile = directory / "profile";
  browser->connection_->process = std::make_unique<Process>(
      std::vector<std::string>{"/usr/bin/chromium", "--headless", "--no-sandbox",
                               "--disable-dev-shm-usage", "--disable-gpu-sandbox", "--use-gl=angle",
                               "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                               "--remote-debugging-port=0", "--user-data-dir=" + profile.string(),
                               "--no-first-run", "--window-size=1280,800", "about:blank"},
      directory / "browser.err", directory / "browser.out");
  const int port = debuggingPort(profile);
  if (port == 0) return nullptr;
  const std::string url = pageTarget(port);
  const std::string target = url.substr(url.find("/devtools"));
  auto& socket = browser->connection_->socket;
  socket.next_layer().connect(local(port));
  socket.handshake("127.0.0.1:" + std::to_string(port), target);
  socket.read_message_max(std::size_t{64} << 20U);
  for (const char* domain : {"Page.enable", "Runtime.enable", "Log.enable"}) {
    browser->call(domain);
  }
  return browser;
}

void Browser::note(const Json& event) {
  const std::string method = event.value("method", "");
  const Json parameters = event.value("params", Json::object());
  if (method == "Runtime.exceptionThrown") errors_.push_back(parameters.dump());
  if (method == "Runtime.consoleAPICalled" && parameters["type"] == "error") {
    errors_.push_back(parameters.dump());
  }
  if (method == "Log.entryAdded" && parameters["entry"]["level"] == "error") {
    errors_.push_back(parameters["entry"].dump());
  }
}

Browser::Json Browser::call(const std::string& method, const Json& parameters) {
  const int id = ++connection_->calls;
  auto& socket = connection_->socket;
  socket.write(
      boost::asio::buffer(Json{{"id", id}, {"method", method}, {"params", parameters}}.dump()));
  for (;;) {
    beast::flat_buffer buffer;
    socket.read(buffer);
    const Json message = Json::parse(beast::buffers_to_string(buffer.data()));
    if (message.value("id", 0) == id) return message.value("result", Json::object());
    note(message);
  }
}

void Browser::resize(int width, int height, bool phone) {
  call("Emulation.setDeviceMetricsOverride",
       {{"width", width}, {"height", height}, {"deviceScaleFactor", 1}, {"mobile", phone}});
}

void Browser::dark(bool wanted) {
  const Json scheme = {{"name", "prefers-color-scheme"}, {"value", wanted ? "dark" : "light"}};
  call("Emulation.setEmulatedMedia", {{"features", Json::array({scheme})}});
}

void Browser::open(const std::string& url) { call("Page.navigate", {{"url", url}}); }

Browser::Json Browser::evaluate(const std::string& expression) {
  const Json outcome =
      call("Runtime.evaluate",
           {{"expression", expression}, {"returnByValue", true}, {"awaitPromise", true}});
  if (outcome.contains("exceptionDetails")) return {};
  return outcome.value("result", Json::object()).value("value", Json());
}

bool Browser::becomes(const std::string& expression, int seconds) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
  while (std::chrono::steady_clock::now() < until) {
    if (evaluate("Boolean(" + expression + ")") == true) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

void Browser::press(const std::string& key) {
  for (const char* type : {"keyDown", "keyUp"}) {
    Json event = {{"type", type}, {"key", key}};
    if (key.size() == 1) event["text"] = key;
    call("Input.dispatchKeyEvent", event);
  }
}

void Browser::screenshot(const fs::path& file) {
  const std::string text = call("Page.captureScreenshot", {{"format", "png"}})["data"];
  namespace base64 = beast::detail::base64;
  std::string bytes(base64::decoded_size(text.size()), '\0');
  bytes.resize(base64::decode(bytes.data(), text.data(), text.size()).first);
  std::ofstream(file, std::ios::binary) << bytes;
}

}  // namespace waymark::testing
