#include "daemon/control/control_request.h"

#include <random>
#include <string>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

template <typename Request>
Request parsed(const std::string& line) {
  const Result<ControlRequest> request = parseControlRequest(line);
  EXPECT_TRUE(request) << request.error().message;
  if (!request || !std::holds_alternative<Request>(*request)) {
    ADD_FAILURE() << "another request: " << line;
    return {};
  }
  return std::get<Request>(*request);
}

std::string errorOf(const std::string& line) {
  const Result<ControlRequest> request = parseControlRequest(line);
  return request ? "no error" : request.error().message;
}

TEST(ControlRequest, EveryCommand) {
  parsed<StatusRequest>(R"({"command":"status"})");
  parsed<SaveMapRequest>(R"( { "command" : "save-map" } )");
  EXPECT_EQ(parsed<LoadMapRequest>(R"({"command":"load-map"})").file, "");
  EXPECT_EQ(parsed<LoadMapRequest>(R"({"file":"/m.json","command":"load-map"})").file, "/m.json");
  parsed<ResetRequest>(R"({"command":"reset"})");
  parsed<CalibrationRequest>(R"({"command":"calibration"})");
  EXPECT_TRUE(parsed<RecordRequest>(R"({"command":"record","action":"start"})").start);
  EXPECT_FALSE(parsed<RecordRequest>(R"({"command":"record","action":"stop"})").start);
  parsed<ReloadRequest>(R"({"command":"reload"})");
  EXPECT_EQ(parsed<SetLogLevelRequest>(R"({"command":"set-log-level","level":"debug"})").level,
            LogLevel::kDebug);
}

TEST(ControlRequest, ErrorsNameWhatIsWrong) {
  EXPECT_EQ(errorOf(""), "request:1:1: is not JSON: it is cut off here");
  EXPECT_EQ(errorOf("status"), "request:1:1: is not JSON");
  EXPECT_EQ(errorOf("[1]"), "request: must be an object {...}");
  EXPECT_EQ(errorOf("{}"), "command: is missing");
  EXPECT_EQ(errorOf(R"({"command":1})"), "command: must be text");
  EXPECT_EQ(errorOf(R"({"command":"fly"})"),
            "command: \"fly\" is not known; known are status, save-map, load-map, reset, "
            "calibration, record, preview, reload, set-log-level");
  EXPECT_EQ(errorOf(R"({"command":"status","file":"/m"})"), "status: file: unknown key");
  EXPECT_EQ(errorOf(R"({"command":"load-map","file":"m"})"),
            "load-map: file: must be an absolute path");
  EXPECT_EQ(errorOf(R"({"command":"load-map","file":7})"), "load-map: file: must be text");
  EXPECT_EQ(errorOf(R"({"command":"record"})"), "record: action: is missing");
  EXPECT_EQ(errorOf(R"({"command":"record","action":"go"})"),
            "record: action: must be \"start\" or \"stop\"");
  EXPECT_EQ(errorOf(R"({"command":"set-log-level","level":"loud"})"),
            R"(set-log-level: level: must be "error", "warning", "info" or "debug")");
}

// Whatever comes is a request or an error of one line.
TEST(ControlRequest, Garbage) {
  std::mt19937 rng(5);
  const std::string good = R"({"command":"load-map","file":"/m.json"})";
  for (int i = 0; i < 5000; ++i) {
    std::string line = good;
    for (unsigned changes = 1 + rng() % 4; changes > 0; --changes) {
      line[rng() % line.size()] = static_cast<char>(rng() % 256);
    }
    if (rng() % 4 == 0) line.resize(rng() % line.size());
    (void)parseControlRequest(line);
  }
  EXPECT_EQ(errorOf(std::string(4096, '[')).substr(0, 8), "request:");
}

}  // namespace
}  // namespace waymark::daemon
