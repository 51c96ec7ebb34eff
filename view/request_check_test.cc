#include "view/request_check.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::view {
namespace {

const std::vector<std::string> kFiles = {"index.html", "view.js"};
const std::string kToken = "0123456789abcdef";

RequestHead get(const std::string& target) {
  return {.method = "GET", .target = target, .host = "localhost:8787"};
}
RequestHead socket(const std::string& origin, const std::string& target = "/ws") {
  RequestHead request = get(target);
  request.upgrade = true;
  request.origin = origin;
  return request;
}
int statusOf(const RequestHead& request, const Access& access = {}) {
  return checkRequest(request, access, kFiles).status;
}

TEST(RequestCheck, ThePageAndWhatBelongsToIt) {
  EXPECT_EQ(checkRequest(get("/"), {}, kFiles).file, "index.html");
  EXPECT_EQ(checkRequest(get("/view.js"), {}, kFiles).file, "view.js");
  EXPECT_EQ(checkRequest(get("/state.json"), {}, kFiles).resource, Resource::kState);
  EXPECT_EQ(checkRequest(get("/metrics"), {}, kFiles).resource, Resource::kMetrics);
  EXPECT_EQ(checkRequest(get("/calib.yml"), {}, kFiles).resource, Resource::kCalibration);
  for (const char* nothing : {"/other.js", "/../etc/passwd", "/view.js/", "view.js", "", "//",
                              "/%2e%2e/view.js", "/view.js%00", "http://localhost/view.js"}) {
    EXPECT_EQ(statusOf(get(nothing)), 404) << nothing;
  }
}

TEST(RequestCheck, OtherHostsAreNotThisOne) {
  for (const char* good : {"localhost", "LOCALHOST:1", "127.0.0.1:8787", "[::1]:8787"}) {
    RequestHead request = get("/");
    request.host = good;
    EXPECT_EQ(statusOf(request), 200) << good;
  }
  // A name of somebody else's that leads here.
  for (const char* bad :
       {"", "evil.example", "localhost.evil.example:8787", "127.0.0.1.evil", "["}) {
    RequestHead request = get("/");
    request.host = bad;
    EXPECT_EQ(statusOf(request), 421) << bad;
  }
}

TEST(RequestCheck, SocketsAreForOurOwnPage) {
  EXPECT_EQ(statusOf(socket("http://localhost:8787")), 101);
  EXPECT_EQ(statusOf(socket("")), 101) << "no browser";
  for (const char* bad : {"http://evil.example", "http://localhost", "http://localhost:8788",
                          "null", "http://localhost:8787.evil"}) {
    EXPECT_EQ(statusOf(socket(bad)), 403) << bad;
  }
  EXPECT_EQ(statusOf(get("/ws")), 426);
  EXPECT_EQ(statusOf(socket("", "/metrics")), 400);
}

TEST(RequestCheck, OnlyReading) {
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "", "get"}) {
    RequestHead request = get("/");
    request.method = method;
    EXPECT_EQ(statusOf(request), 405) << method;
  }
}

TEST(RequestCheck, WithATokenOnlyThePageIsFree) {
  Access access;
  access.token = kToken;
  EXPECT_EQ(statusOf(get("/"), access), 200);
  for (const char* target : {"/metrics", "/state.json", "/state.json?token=", "/nothing",
                             "/state.json?token=0123456789abcdeg", "/state.json?tokens=x"}) {
    EXPECT_EQ(statusOf(get(target), access), 401) << target;
  }
  EXPECT_EQ(statusOf(socket("http://localhost:8787"), access), 401);
  EXPECT_EQ(statusOf(socket("http://localhost:8787", "/ws?a=b&token=" + kToken), access), 101);
  EXPECT_EQ(statusOf(get("/metrics?token=" + kToken), access), 200);
  RequestHead bearer = get("/metrics");
  bearer.authorization = "Bearer " + kToken;
  EXPECT_EQ(statusOf(bearer, access), 200);
  bearer.host = "robot.local";
  EXPECT_EQ(statusOf(bearer, access), 200) << "whoever knows it was told";
  bearer.authorization = "Basic " + kToken;
  EXPECT_EQ(statusOf(bearer, access), 401);
}

TEST(RequestCheck, Tokens) {
  EXPECT_TRUE(sameToken(kToken, kToken));
  EXPECT_FALSE(sameToken("", ""));
  EXPECT_FALSE(sameToken(kToken + "x", kToken));
  EXPECT_FALSE(sameToken(kToken.substr(1), kToken));
  EXPECT_TRUE(isToken(kToken));
  for (const std::string& bad : {std::string("short"), std::string(201, 'a'),
                                 std::string("0123456789abcde&"), std::string()}) {
    EXPECT_FALSE(isToken(bad));
  }
}

}  // namespace
}  // namespace waymark::view
