// waymark-view as programs meet it: commands, what others may read, a hostile client, a slow one.
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/beast/core.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <poll.h>

#include "tests/pretended_daemon.h"
#include "tests/process.h"
#include "tests/running_view.h"

namespace waymark::testing {
namespace {

namespace beast = boost::beast;
namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::milliseconds;

TEST_F(ViewTest, CommandsOfAPageReachTheDaemon) {
  start(configuration());
  view({"--allow-control"});
  boost::asio::io_context io;
  const auto socket = look(io);
  const auto answerTo = [&](const std::string& command) {
    socket->write(boost::asio::buffer(command));
    for (;;) {
      beast::flat_buffer buffer;
      socket->read(buffer);
      json message = json::parse(beast::buffers_to_string(buffer.data()));
      if (message["type"] == "answer") return message;
    }
  };
  const json saved = answerTo(R"({"command":"save-map"})");
  EXPECT_EQ(saved["ok"], true) << saved;
  EXPECT_TRUE(fs::exists(map_));
  EXPECT_EQ(answerTo(R"({"command":"reset"})")["ok"], true);
  EXPECT_TRUE(reaches("map.resets", 1));
  EXPECT_EQ(answerTo(R"({"command":"record-start"})")["error"],
            "record.directory is not configured");
  EXPECT_EQ(answerTo(R"({"command":"load-map","file":"/etc/passwd"})")["ok"], false);
  EXPECT_EQ(answerTo("nonsense")["ok"], false);
}

TEST_F(ViewTest, ProgramsReadStateAndMetrics) {
  view();
  const PretendedDaemon daemon(url_, "TEST_");
  const auto told = [&](const char* what) {
    return get("/metrics").find(what) != std::string::npos;
  };
  EXPECT_TRUE(eventually([&] { return told("waymark_up 1\n"); }));
  EXPECT_TRUE(eventually([&] { return told("waymark_map_markers 48\n"); })) << "comes again";
  const std::string metrics = get("/metrics");
  EXPECT_TRUE(metrics.starts_with("HTTP/1.1 200 OK\r\n"));
  EXPECT_NE(metrics.find("waymark_map_markers 48\n"), std::string::npos) << metrics;
  EXPECT_NE(metrics.find("waymark_status{status=\"tracking\"} 1\n"), std::string::npos);
  const std::string state = get("/state.json");
  const json parsed = json::parse(state.substr(state.find("\r\n\r\n") + 4));
  EXPECT_EQ(parsed["map"]["markers"].size(), 48U);
  EXPECT_EQ(parsed["pose"]["status"], "tracking");
}

TEST_F(ViewTest, StrangersGetNothing) {
  view();
  EXPECT_TRUE(raw("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").starts_with("HTTP/1.1 421 "));
  EXPECT_TRUE(get("/../../etc/passwd").starts_with("HTTP/1.1 404 "));
  EXPECT_TRUE(get("/ws").starts_with("HTTP/1.1 426 "));
  const std::string upgrade =
      "Upgrade: websocket\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
      "Sec-WebSocket-Version: 13\r\nConnection: Upgrade\r\n";
  EXPECT_TRUE(raw("GET /ws HTTP/1.1\r\nHost: 127.0.0.1:1\r\nOrigin: http://evil.example\r\n" +
                  upgrade + "\r\n")
                  .starts_with("HTTP/1.1 403 "));
  const std::string page = get("/");
  EXPECT_NE(page.find("Content-Security-Policy: default-src 'none'; script-src 'self'"),
            std::string::npos);
  EXPECT_NE(page.find("X-Content-Type-Options: nosniff"), std::string::npos);
  // Too long, half a request, and noise: let go, and served on.
  (void)raw("GET /" + std::string(100'000, 'a') + " HTTP/1.1\r\n\r\n");
  (void)raw("GET / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n");
  (void)raw(std::string("\x16\x03\x01\x00\xff\x00", 6) + std::string(5000, '\xff'));
  EXPECT_TRUE(get("/").starts_with("HTTP/1.1 200 OK"));
}

TEST_F(ViewTest, ItOnlyLooksUnlessAllowed) {
  view();
  boost::asio::io_context io;
  const auto socket = look(io);
  socket->write(boost::asio::buffer(std::string(R"({"command":"reset"})")));
  for (;;) {
    beast::flat_buffer buffer;
    socket->read(buffer);
    const json message = json::parse(beast::buffers_to_string(buffer.data()));
    if (message["type"] == "hello") {
      EXPECT_EQ(message["control"], false);
    }
    if (message["type"] != "answer") continue;
    EXPECT_EQ(message["ok"], false);
    EXPECT_EQ(message["error"], "this view only looks: --allow-control");
    break;
  }
}

TEST_F(ViewTest, OthersNeedTheToken) {
  const std::string token = "abcdefghijklmnop0123";
  std::ofstream(directory_ / "token") << token << "\n";
  const auto refused = [&](std::vector<std::string> options, const std::string& why) {
    options.insert(options.begin(), {WAYMARK_VIEW, "--port", "0", "--page", WAYMARK_VIEW_PAGE,
                                     "--health", WAYMARK_HEALTH_MD});
    const ProgramResult result = runProgram(options);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.err.find(why), std::string::npos) << result.err;
  };
  refused({"--listen", "0.0.0.0"}, "--listen 0.0.0.0: others could look: --token-file FILE");
  refused({"--listen", "here"}, "'here' is no address");
  std::ofstream(directory_ / "short") << "abc\n";
  refused({"--token-file", directory_ / "short"}, "short: must be one line of 16 to 200 letters");
  view({"--token-file", directory_ / "token"});
  EXPECT_TRUE(get("/").starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(get("/state.json").starts_with("HTTP/1.1 401 "));
  EXPECT_TRUE(get("/state.json?token=" + token).starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(
      get("/metrics", "Authorization: Bearer " + token + "\r\n").starts_with("HTTP/1.1 200 "));
}

TEST_F(ViewTest, APageThatSaysWhenItIsReadyGetsNoMoreBeforeThat) {
  view();
  const PretendedDaemon daemon(url_, "TEST_");
  boost::asio::io_context io;
  const auto socket = look(io);
  const auto readable = [&] {
    pollfd waiting{socket->next_layer().native_handle(), POLLIN, 0};
    return poll(&waiting, 1, 500) > 0;
  };
  const auto readAll = [&] {
    int messages = 0;
    while (readable()) {
      beast::flat_buffer buffer;
      socket->read(buffer);
      if (++messages > 100) break;
    }
    return messages;
  };
  const std::string more = R"({"command":"more"})";
  socket->write(boost::asio::buffer(more));
  const int first = readAll();
  socket->write(boost::asio::buffer(more));
  const int second = readAll();
  EXPECT_GE(second, 1);
  // What greets it, all parts, and two rounds of at most nine; without rounds it would be thirty
  // poses a second and more.
  EXPECT_LE(first + second, 2 + 9 + 9 + 9);
}

// Sixteen that read, one that does not, and as many as there are places.
TEST_F(ViewTest, ASlowClientCostsItselfOnly) {
  view();
  const PretendedDaemon daemon(url_, "TEST_", 150.0);
  boost::asio::io_context io;
  const auto slow = look(io);  // and never reads
  std::vector<std::unique_ptr<Socket>> many;
  for (int i = 0; i < 31; ++i) many.push_back(look(io));
  EXPECT_TRUE(raw("GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\n"
                  "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                  "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n")
                  .starts_with("HTTP/1.1 503 "))
      << "all places are taken";
  // Each of those that read sees the frames of now.
  for (int round = 0; round < 20; ++round) {
    std::this_thread::sleep_for(milliseconds(50));
    for (std::size_t i = 0; i < 16; ++i) {
      beast::flat_buffer buffer;
      many[i]->read(buffer);
      EXPECT_TRUE(json::accept(beast::buffers_to_string(buffer.data())));
    }
  }
  EXPECT_TRUE(get("/metrics").find("waymark_up 1\n") != std::string::npos);
}

}  // namespace
}  // namespace waymark::testing
