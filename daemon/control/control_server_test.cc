#include "daemon/control/control_server.h"

#include <chrono>
#include <cstring>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>

#include "daemon/control/testing_client.h"
#include "tests/temporary_directory.h"

namespace waymark::daemon {
namespace {

using testing::TestClient;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

class ControlServerTest : public ::testing::Test {
 protected:
  void open(const ControlServer::Options& options) {
    auto opened = ControlServer::open(path_, options);
    ASSERT_TRUE(opened) << opened.error().message;
    server_ = std::move(opened).value();
    server_->setHandler([this](ControlServer::ClientId client, const std::string& request) {
      requests_.push_back(request);
      if (request == "later") {
        waiting_.push_back(client);
        return ControlServer::Answer{};
      }
      if (request == "large") return ControlServer::Answer{std::string(1 << 20, 'x'), false};
      return ControlServer::Answer{"re " + request, request == "bad"};
    });
  }
  void serve(int rounds = 8) {
    for (int i = 0; i < rounds; ++i) server_->serve(now_ns_);
  }
  std::map<std::string, std::uint64_t> counters() const {
    std::map<std::string, std::uint64_t> all;
    server_->reportCounters([&](const char* name, std::uint64_t value) { all[name] = value; });
    return all;
  }
  std::string openError() const {
    const auto opened = ControlServer::open(path_);
    return opened ? "no error" : opened.error().message;
  }

  const waymark::testing::TemporaryDirectory directory_;
  const std::filesystem::path path_ = directory_ / "control.sock";
  std::unique_ptr<ControlServer> server_;
  std::int64_t now_ns_ = 5 * kSecond_ns;
  std::vector<std::string> requests_;
  std::vector<ControlServer::ClientId> waiting_;
};

TEST_F(ControlServerTest, AnswersLineByLine) {
  open({});
  const TestClient client(path_);
  client.send("a\nb\nc");
  serve();
  EXPECT_EQ(client.received(), "re a\nre b\n");
  client.send("d\n");
  serve();
  EXPECT_EQ(client.received(), "re cd\n");
  EXPECT_EQ(counters()["control.requests"], 3U);
}

TEST_F(ControlServerTest, OnlyOwnerAndGroupMayUseIt) {
  const mode_t before = ::umask(0077);
  open({});
  ::umask(before);
  struct stat file {};
  ASSERT_EQ(::stat(path_.c_str(), &file), 0);
  EXPECT_EQ(file.st_mode & 07777, 0660U);
  server_.reset();
  EXPECT_NE(::stat(path_.c_str(), &file), 0) << "it goes with the daemon";
}

TEST_F(ControlServerTest, WhatStandsInItsPlace) {
  // A socket of a daemon that was killed.
  const UniqueFd dead(::socket(AF_UNIX, SOCK_STREAM, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path_.c_str(), path_.native().size());
  ASSERT_EQ(::bind(dead.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  open({});
  EXPECT_EQ(openError(), path_.string() + ": another daemon listens on this control socket");
  EXPECT_TRUE(TestClient(path_).connected()) << "the other one goes on";
  server_.reset();
  std::ofstream(path_) << "text";
  EXPECT_EQ(openError(), path_.string() + ": is a file, where the control socket should be");
  EXPECT_TRUE(std::filesystem::exists(path_));
}

// A daemon that has bound its socket and does not listen yet looks like one that was killed.
TEST_F(ControlServerTest, AnotherDaemonThatIsJustStarting) {
  const UniqueFd directory(::open(directory_.path().c_str(), O_RDONLY | O_DIRECTORY));
  ASSERT_EQ(::flock(directory.get(), LOCK_EX), 0);
  const UniqueFd other(::socket(AF_UNIX, SOCK_STREAM, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path_.c_str(), path_.native().size());
  ASSERT_EQ(::bind(other.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  std::future<std::string> error = std::async(std::launch::async, [this] { return openError(); });
  EXPECT_EQ(error.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  ASSERT_EQ(::listen(other.get(), 1), 0);
  ASSERT_EQ(::flock(directory.get(), LOCK_UN), 0);
  EXPECT_EQ(error.get(), path_.string() + ": another daemon listens on this control socket");
  EXPECT_TRUE(std::filesystem::exists(path_));
}

TEST_F(ControlServerTest, WhatIsWrongWithAPlaceOnAnyDay) {
  EXPECT_TRUE(ControlServer::checkPlace(directory_ / "none/control.sock")) << "made at the start";
  open({});
  EXPECT_TRUE(ControlServer::checkPlace(path_)) << "the daemon may be running";
  EXPECT_FALSE(ControlServer::checkPlace(directory_ / std::string(120, 'x')));
  std::ofstream(directory_ / "file") << "text";
  EXPECT_FALSE(ControlServer::checkPlace(directory_ / "file"));
}

TEST_F(ControlServerTest, PathsThatCannotBe) {
  const auto nowhere = ControlServer::open(directory_ / "none/control.sock");
  ASSERT_FALSE(nowhere);
  EXPECT_NE(
      nowhere.error().message.find("none/control.sock: the control socket cannot be made: No"),
      std::string::npos);
  const auto long_name = ControlServer::open(directory_ / std::string(120, 'x'));
  ASSERT_FALSE(long_name);
  EXPECT_NE(long_name.error().message.find("the system takes 107 bytes"), std::string::npos);
}

TEST_F(ControlServerTest, RequestsThatAreTooLongOrNotFinished) {
  open({.max_line_bytes = 100});
  const TestClient just_right(path_);
  const TestClient too_long(path_);
  const TestClient endless(path_);
  const TestClient half(path_);
  just_right.send(std::string(100, 'x') + "\n");
  too_long.send(std::string(101, 'x') + "\n");
  endless.send(std::string(100'000, 'x'));
  half.send("half");
  half.finish();
  serve();
  EXPECT_EQ(just_right.received(), "re " + std::string(100, 'x') + "\n");
  const std::string rejection = "{\"ok\":false,\"error\":\"the request is too long\"}\n<end>";
  EXPECT_EQ(too_long.received(), rejection);
  EXPECT_EQ(endless.received(), rejection);
  EXPECT_EQ(half.received(),
            "{\"ok\":false,\"error\":\"the request does not end with a newline\"}\n<end>");
  EXPECT_EQ(requests_.size(), 1U);
  EXPECT_EQ(counters()["control.bad_requests"], 3U);
}

TEST_F(ControlServerTest, AClientThatSaysItIsDoneGetsItsAnswers) {
  open({});
  const TestClient client(path_);
  client.send("a\nb\n");
  client.finish();
  serve();
  EXPECT_EQ(client.received(), "re a\nre b\n<end>");
}

TEST_F(ControlServerTest, AnswersThatComeLater) {
  open({});
  const TestClient client(path_);
  TestClient impatient(path_);
  client.send("later\nnext\n");
  impatient.send("later\n");
  serve();
  ASSERT_EQ(waiting_.size(), 2U);
  EXPECT_EQ(client.received(), "");
  impatient.leave();
  now_ns_ += 60 * kSecond_ns;  // it is the daemon that takes its time
  serve();
  for (const ControlServer::ClientId id : waiting_) server_->answer(id, "done", now_ns_);
  serve();
  EXPECT_EQ(client.received(), "done\nre next\n");
  server_->answer(waiting_[0], "nobody asked", now_ns_);
  serve();
  EXPECT_EQ(client.received(), "");
}

TEST_F(ControlServerTest, ClientsThatDoNothingGoodAreLetGo) {
  open({});
  const TestClient silent(path_);
  const TestClient talkative(path_);
  const TestClient deaf(path_);
  const TestClient good(path_);
  for (int s = 0; s < 11; ++s) {
    talkative.send("bad\n");
    deaf.send("large\n");
    good.send("good\n");
    serve();
    now_ns_ += kSecond_ns;
  }
  serve();
  EXPECT_EQ(silent.received(), "{\"ok\":false,\"error\":\"idle for too long\"}\n<end>");
  EXPECT_TRUE(talkative.received().ends_with("idle for too long\"}\n<end>"));
  const std::string heard = deaf.received();
  EXPECT_TRUE(heard.ends_with("x<end>")) << "cut off, for nobody took it";
  EXPECT_LT(heard.size(), std::size_t{1} << 20U);
  EXPECT_FALSE(good.received().ends_with("<end>"));
  EXPECT_EQ(counters()["control.dropped_clients"], 3U);
}

TEST_F(ControlServerTest, ANewcomerGetsThePlaceOfTheIdlest) {
  open({.max_clients = 3});
  std::vector<std::unique_ptr<TestClient>> clients;
  for (int i = 0; i < 3; ++i) {
    clients.push_back(std::make_unique<TestClient>(path_));
    serve();
    now_ns_ += 10'000'000;
  }
  clients[0]->send("busy\n");
  serve();
  const TestClient newcomer(path_);
  newcomer.send("hello\n");
  serve();
  EXPECT_EQ(newcomer.received(), "") << "nobody has been idle for long";
  now_ns_ += 200'000'000;
  serve();
  EXPECT_EQ(newcomer.received(), "re hello\n");
  EXPECT_EQ(clients[0]->received(), "re busy\n");
  EXPECT_EQ(clients[1]->received(),
            "{\"ok\":false,\"error\":\"idle while others waited for a place\"}\n<end>");
  EXPECT_EQ(clients[2]->received(), "");
}

TEST_F(ControlServerTest, WhenAllWaitForTheDaemonANewcomerIsRejected) {
  open({.max_clients = 2});
  const TestClient a(path_);
  const TestClient b(path_);
  a.send("later\n");
  b.send("later\n");
  serve();
  now_ns_ += kSecond_ns;
  const TestClient newcomer(path_);
  serve();
  EXPECT_EQ(newcomer.received(),
            "{\"ok\":false,\"error\":\"all places are taken by busy clients\"}\n<end>");
  EXPECT_EQ(counters()["control.refused_clients"], 1U);
}

TEST_F(ControlServerTest, WhenAllAreBusyForLongANewcomerIsRejected) {
  open({.max_clients = 1});
  const TestClient busy(path_);
  const TestClient newcomer(path_);
  for (int i = 0; i <= 10; ++i) {
    EXPECT_EQ(newcomer.received(), "");
    busy.send("good\n");
    serve(1);
    now_ns_ += 50'000'000;
  }
  serve(1);
  EXPECT_TRUE(newcomer.received().ends_with("all places are taken by busy clients\"}\n<end>"));
  EXPECT_FALSE(busy.received().ends_with("<end>"));
  EXPECT_EQ(counters()["control.refused_clients"], 1U);
}

// One round is one request of each: a client with a thousand of them does not keep the others
// waiting, nor whoever calls serve().
TEST_F(ControlServerTest, ARoundIsBounded) {
  open({});
  const TestClient greedy(path_);
  std::string many;
  for (int i = 0; i < 1000; ++i) many += "g\n";
  greedy.send(many);
  const TestClient modest(path_);
  modest.send("m\n");
  serve(1);
  EXPECT_EQ(requests_, (std::vector<std::string>{"g", "m"}));
  std::string answers;
  for (int i = 0; i < 10; ++i) {
    serve(100);
    answers += greedy.received();
  }
  EXPECT_EQ(answers.size(), std::string("re g\n").size() * 1000) << "none is forgotten";
}

// What nobody waits for any more need not be done.
TEST_F(ControlServerTest, WhoHangsUpWhileHeWaitsIsTold) {
  open({});
  std::vector<ControlServer::ClientId> gone;
  server_->setGoneHandler([&](ControlServer::ClientId client) { gone.push_back(client); });
  TestClient hasty(path_);
  TestClient served(path_);
  const TestClient patient(path_);
  hasty.send("later\n");
  patient.send("later\n");
  served.send("a\n");
  serve();
  ASSERT_EQ(waiting_.size(), 2U);
  hasty.leave();
  served.leave();
  serve();
  EXPECT_EQ(gone, std::vector<ControlServer::ClientId>{waiting_[0]});
}

}  // namespace
}  // namespace waymark::daemon
