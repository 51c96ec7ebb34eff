#include "view/control_link.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::view {
namespace {

std::string sent(const std::string& command) {
  const Result<io::Json> request = requestOf(command);
  return request ? request->dump() : "error: " + request.error().message;
}

TEST(ControlLink, CommandsOfThePageAreRequestsToTheDaemon) {
  for (const char* plain : {"save-map", "load-map", "reset"}) {
    const std::string command = std::string(R"({"command":")") + plain + "\"}";
    EXPECT_EQ(sent(command), command);
  }
  EXPECT_EQ(sent(R"({"command":"record-start"})"), R"({"command":"record","action":"start"})");
  EXPECT_EQ(sent(R"({"command":"record-stop"})"), R"({"command":"record","action":"stop"})");
}

TEST(ControlLink, AnythingElseIsRefused) {
  for (const char* bad :
       {"", "{}", "[]", "3", "{\"command\":3}", R"({"command":"reload"})",
        R"({"command":"status"})", R"({"command":"load-map","file":"/etc/shadow"})",
        R"({"command":"record-"})", R"([{"command":"reset"}])", "{\"command\":\"reset\"",
        R"({"command":"set-log-level"})", R"({"command":"save-calibration"})"}) {
    EXPECT_TRUE(sent(bad).starts_with("error: ")) << bad;
  }
}

}  // namespace
}  // namespace waymark::view
