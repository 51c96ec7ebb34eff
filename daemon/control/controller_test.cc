#include "daemon/control/controller.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <poll.h>

#include "base/clock.h"
#include "daemon/control/testing_client.h"
#include "daemon/maps/testing_map_worker.h"
#include "daemon/system/testing_service_manager.h"
#include "io/calibrations/calibration_file.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;
using io::Json;
using std::chrono::milliseconds;

// The daemon's parts as they are, without cameras and network, and a client of the control socket.
class ControllerTest : public testing::MapWorkerFixture {
 protected:
  ~ControllerTest() override {
    if (recorder_thread_.joinable()) {
      recorder_->requestStop();
      recorder_thread_.join();
    }
    stop();  // nobody answers any more
  }

  void addRecorder(const fs::path& directory) {
    RecorderOptions options;
    options.log.directory = directory;
    options.log.keep_free_bytes = 0;
    options.at_start = false;
    options.frame_buffer_bytes = std::size_t{1} << 20U;
    options.message_buffer_bytes = std::size_t{1} << 16U;
    recorder_ = std::make_unique<Recorder>(options, std::vector<capture::RecordedFile>{}, log_);
    recorder_thread_ = std::thread([this] { recorder_->run(); });
  }

  [[nodiscard]] static std::string configurationText(const std::string& more = "") {
    return "[camera]\nsource = 'sim:walls'\n[slam]\ndictionary = '4X4_50'\n"
           "marker_size_m = 0.2\nmap_out = 'map.json'\n" +
           more;
  }
  void write(const std::string& text) const { std::ofstream(configuration_file_) << text; }

  // The daemon begins with this map, and the configuration as it is in the file.
  void begin(slam::Map map, const std::string& configuration = configurationText()) {
    write(configuration);
    const Result<Configuration> read = readConfiguration(configuration_file_);
    ASSERT_TRUE(read) << read.error().message;
    own_log_.setLevel(read->log.level);
    settings_.map.save_interval_s = read->slam.map.save_interval_s;
    start(std::move(map));
    publisher_ = std::make_unique<Publisher>(read->publish, BodyMotion::Options{}, "4X4_50",
                                             output_, camera_status_, frames_, health_, own_log_);
    controller_ =
        std::make_unique<Controller>(Controller::Parts{own_log_, *publisher_, *worker_, output_,
                                                       service_, preview_, recorder_.get()},
                                     *read, configuration_file_);
    auto opened = ControlServer::open(directory_ / "control.sock");
    ASSERT_TRUE(opened) << opened.error().message;
    server_ = std::move(opened).value();
    server_->setHandler([this](ControlServer::ClientId client, const std::string& line) {
      ControlServer::Answer answer = controller_->handle(client, line);
      answered_at_once_ = answer.line.has_value();
      bad_request_ = answer.bad_request;
      return answer;
    });
    client_ = std::make_unique<testing::TestClient>(server_->path());
    ASSERT_TRUE(client_->connected());
  }

  // What becomes of a request, from the client's line to the daemon's.
  Json ask(const std::string& request) {
    client_->send(request + "\n");
    std::string line;
    const auto until = std::chrono::steady_clock::now() + milliseconds(10'000);
    while (!line.ends_with('\n') && std::chrono::steady_clock::now() < until) {
      server_->serve(monotonicNs());
      pollfd answers{controller_->answersFd(), POLLIN, 0};
      if (poll(&answers, 1, 1) > 0) controller_->deliverAnswers(*server_);
      line += client_->received();
    }
    EXPECT_EQ(std::ranges::count(line, '\n'), 1) << line;
    return Json::parse(line, nullptr, false);
  }
  Json askFor(const std::string& command) { return ask(R"({"command":")" + command + "\"}"); }

  [[nodiscard]] std::map<std::string, std::uint64_t> counters() const {
    std::map<std::string, std::uint64_t> all;
    controller_->reportCounters([&](const char* name, std::uint64_t value) { all[name] = value; });
    return all;
  }
  [[nodiscard]] bool eventually(const std::function<bool()>& holds) const {
    const auto until = std::chrono::steady_clock::now() + milliseconds(10'000);
    while (!holds()) {
      if (std::chrono::steady_clock::now() > until) return false;
      std::this_thread::sleep_for(milliseconds(10));
    }
    return true;
  }

  const fs::path configuration_file_ = directory_ / "waymarkd.toml";
  Log own_log_{LogLevel::kError, false};
  const ServiceManager service_{};
  TripleBuffer<health_t> health_;
  PreviewLink preview_{4, 2};
  std::unique_ptr<Recorder> recorder_;
  std::thread recorder_thread_;
  std::unique_ptr<Publisher> publisher_;
  std::unique_ptr<Controller> controller_;
  std::unique_ptr<ControlServer> server_;
  std::unique_ptr<testing::TestClient> client_;
  bool answered_at_once_ = false;
  bool bad_request_ = false;
};

const Json kOk = {{"ok", true}};

// --- Status --------------------------------------------------------------------------------------

TEST_F(ControllerTest, StatusIsTheLatestHealthWithMapRecorderAndLogLevel) {
  ASSERT_NO_FATAL_FAILURE(begin(wallMap(), configurationText("[log]\nlevel = 'warning'\n")));
  health_t health{};
  health.version = "1.2.3";
  health.status = pose_t::STATUS_TRACKING;
  health.counters.resize(1);
  health.counters[0].name = "published.poses";
  health.counters[0].value = 7;
  controller_->setHealth(health);
  output_.map_markers = 8;
  output_.map_natural_markers = 2;
  output_.map_keyframes = 3;
  output_.map_pieces = 4;

  const Json status = askFor("status");
  EXPECT_TRUE(answered_at_once_);
  EXPECT_EQ(status["ok"], true);
  EXPECT_EQ(status["version"], "1.2.3");
  EXPECT_EQ(status["status"], "tracking");
  EXPECT_EQ(status["counters"]["published.poses"], 7);
  EXPECT_EQ(status["map"]["markers"], 8);
  EXPECT_EQ(status["map"]["natural_markers"], 2);
  EXPECT_EQ(status["map"]["keyframes"], 3);
  EXPECT_EQ(status["map"]["pieces"], 4);
  EXPECT_EQ(status["map"]["file"], file_.string());
  EXPECT_EQ(status["map"]["changed_since_save"], false);
  EXPECT_TRUE(status["map"]["last_save_age_s"].is_null()) << "nothing has been saved";
  EXPECT_TRUE(status["recorder"].is_null()) << "there is none";
  EXPECT_EQ(status["log_level"], "warning");

  health.status = pose_t::STATUS_RELOCALIZING;
  controller_->setHealth(health);
  EXPECT_EQ(askFor("status")["status"], "relocalizing");
}

TEST_F(ControllerTest, NamesThatAreNoTextAreToldAllTheSame) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  health_t health{};
  health.camera_reason = "/dev/\xff: gone";
  controller_->setHealth(health);
  EXPECT_EQ(askFor("status")["camera"]["reason"], "/dev/\xEF\xBF\xBD: gone");
}

// --- Preview -------------------------------------------------------------------------------------

TEST_F(ControllerTest, ImagesAreWantedForSomeSecondsAfterEachRequest) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_FALSE(preview_.wanted(monotonicNs()));
  const Json reply = askFor("preview");
  EXPECT_EQ(reply["ok"], true);
  const double lease_s = reply["lease_s"];
  EXPECT_GT(lease_s, 1.0);
  EXPECT_TRUE(preview_.wanted(monotonicNs()));
  EXPECT_FALSE(preview_.wanted(monotonicNs() + static_cast<std::int64_t>(1e9 * lease_s)));
}

// --- Maps ----------------------------------------------------------------------------------------

TEST_F(ControllerTest, ASaveIsAnsweredWhenTheMapIsThere) {
  ASSERT_NO_FATAL_FAILURE(begin(wallMap()));
  const Json reply = askFor("save-map");
  EXPECT_FALSE(answered_at_once_) << "housekeeping never waits";
  EXPECT_EQ(reply["ok"], true);
  EXPECT_TRUE(reply["result"].get<std::string>().starts_with(file_.string() + ": saved 8 markers"))
      << reply;
  EXPECT_TRUE(fs::exists(file_));
  const Json map = askFor("status")["map"];
  EXPECT_EQ(map["last_save"], reply["result"]);
  EXPECT_GE(map["last_save_age_s"], 0.0);
  EXPECT_LT(map["last_save_age_s"], 60.0);
}

TEST_F(ControllerTest, ASaveThatFailsSaysWhy) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_EQ(askFor("save-map"), Json({{"ok", false}, {"error", "there is no map to save"}}));
}

TEST_F(ControllerTest, AResetBeginsANewMapAndALoadBringsOneBack) {
  ASSERT_NO_FATAL_FAILURE(begin(wallMap()));
  ASSERT_EQ(askFor("save-map")["ok"], true);
  EXPECT_EQ(askFor("reset"), Json({{"ok", true},
                                   {"result", "beginning a new map; the one before is in " +
                                                  file_.string() + ".replaced"}}));
  EXPECT_EQ(askFor("save-map")["error"], "there is no map to save");

  const Json loaded = ask(R"({"command":"load-map","file":")" + file_.string() + "\"}");
  EXPECT_EQ(loaded["ok"], true);
  EXPECT_TRUE(
      loaded["result"].get<std::string>().starts_with(file_.string() + ": going on with 8 markers"))
      << loaded;
  EXPECT_EQ(ask(R"({"command":"load-map","file":"/nowhere.json"})")["ok"], false);
  EXPECT_EQ(output_.map_markers, 8);
}

TEST_F(ControllerTest, TheLensInUseIsACalibrationFile) {
  ASSERT_NO_FATAL_FAILURE(begin(wallMap()));
  EXPECT_EQ(askFor("calibration"),
            Json({{"ok", true}, {"result", io::formatCalibration(camera_)}}));
}

TEST_F(ControllerTest, AnAnswerForAClientThatHasLeftIsForgotten) {
  ASSERT_NO_FATAL_FAILURE(begin(wallMap()));
  {
    testing::TestClient hasty(server_->path());
    hasty.send("{\"command\":\"save-map\"}\n");
    for (int i = 0; i < 8; ++i) server_->serve(monotonicNs());
    hasty.leave();
  }
  ASSERT_TRUE(eventually([&] { return fs::exists(file_); }));
  EXPECT_TRUE(askFor("reset")["result"].get<std::string>().starts_with("beginning a new map"))
      << "others get their own";
}

// --- Recorder ------------------------------------------------------------------------------------

TEST_F(ControllerTest, WithoutARecorderNothingIsRecorded) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_EQ(ask(R"({"command":"record","action":"start"})"),
            Json({{"ok", false}, {"error", "record.directory is not configured"}}));
}

TEST_F(ControllerTest, RecordingIsStartedAndStopped) {
  addRecorder(directory_ / "logs");
  ASSERT_NO_FATAL_FAILURE(begin({}));
  const auto state_becomes = [&](const char* state) {
    return eventually([&] { return askFor("status")["recorder"]["state"] == state; });
  };
  EXPECT_TRUE(state_becomes("off"));
  EXPECT_EQ(ask(R"({"command":"record","action":"start"})"), kOk);
  ASSERT_TRUE(state_becomes("recording"));
  constexpr std::array<std::uint8_t, 3> kMessage = {1, 2, 3};
  recorder_->addMessage("POSE", kMessage, 5);  // there is no file before there is something in it
  ASSERT_TRUE(
      eventually([&] { return !askFor("status")["recorder"]["file"].get<std::string>().empty(); }));
  const std::string file = askFor("status")["recorder"]["file"];
  EXPECT_TRUE(file.starts_with((directory_ / "logs").string())) << file;
  EXPECT_TRUE(fs::exists(file));
  EXPECT_EQ(ask(R"({"command":"record","action":"stop"})"), kOk);
  EXPECT_TRUE(state_becomes("off"));
  EXPECT_EQ(askFor("status")["recorder"]["file"], "");
}

TEST_F(ControllerTest, ARecorderThatCannotSaysWhy) {
  write("in the way");
  addRecorder(configuration_file_ / "logs");
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_EQ(ask(R"({"command":"record","action":"start"})"), kOk);
  ASSERT_TRUE(eventually([&] { return askFor("status")["recorder"]["state"] == "paused"; }));
  const std::string reason = askFor("status")["recorder"]["reason"];
  EXPECT_NE(reason.find(configuration_file_.string()), std::string::npos) << reason;
}

// --- Configuration -------------------------------------------------------------------------------

TEST_F(ControllerTest, TheLogLevelHoldsAtOnce) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_EQ(ask(R"({"command":"set-log-level","level":"error"})"), kOk);
  EXPECT_EQ(own_log_.level(), LogLevel::kError);
  EXPECT_EQ(askFor("status")["log_level"], "error");
}

TEST_F(ControllerTest, AReloadAppliesWhatItCanAndNamesTheRest) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  EXPECT_EQ(askFor("reload"),
            Json({{"ok", true}, {"applied", Json::array()}, {"needs_restart", Json::array()}}));

  write(
      "[camera]\nsource = 'sim:ceiling'\n[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.2\n"
      "map_out = 'map.json'\nmap_save_interval_s = 30\n[publish]\ndetections = false\n"
      "[log]\nlevel = 'error'\n");
  const Json reply = askFor("reload");
  EXPECT_EQ(reply["ok"], true);
  EXPECT_EQ(reply["applied"],
            Json({"log.level", "publish.detections", "slam.map_save_interval_s"}));
  EXPECT_EQ(reply["needs_restart"], Json({"camera.source"}));
  EXPECT_EQ(own_log_.level(), LogLevel::kError);
  EXPECT_FALSE(publisher_->detections());
  EXPECT_EQ(worker_->saveInterval(), 30);
  EXPECT_EQ(askFor("reload")["applied"], Json::array()) << "it holds already";
  EXPECT_EQ(counters()["configuration.reloads"], 3U);
  EXPECT_EQ(counters()["configuration.reload_failures"], 0U);
}

TEST_F(ControllerTest, AReloadOfABadFileChangesNothingAndNamesTheFault) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  write(configurationText("[publish]\ndetections = false\n[log]\nlevel = 'loud'\n"));
  const Json reply = askFor("reload");
  EXPECT_EQ(reply["ok"], false);
  const std::string error = reply["error"];
  EXPECT_TRUE(error.starts_with(configuration_file_.string() + ":10:")) << error;
  EXPECT_NE(error.find("log.level"), std::string::npos) << error;
  EXPECT_TRUE(publisher_->detections());
  EXPECT_EQ(own_log_.level(), LogLevel::kInfo);
  EXPECT_EQ(counters()["configuration.reload_failures"], 1U);
  EXPECT_EQ(counters()["configuration.reloads"], 0U);
}

TEST_F(ControllerTest, AReloadBySignalIsToldToTheServiceManager) {
  const testing::NotifySocket manager;
  ASSERT_TRUE(manager.listens());
  ASSERT_NO_FATAL_FAILURE(begin({}));
  write(configurationText("[log]\nlevel = 'error'\n"));
  controller_->reloadBySignal();
  EXPECT_EQ(own_log_.level(), LogLevel::kError);
  EXPECT_TRUE(manager.next(1000).starts_with("RELOADING=1\n"));
  EXPECT_EQ(manager.next(1000), "READY=1");

  write("nonsense");
  controller_->reloadBySignal();
  EXPECT_TRUE(manager.next(1000).starts_with("RELOADING=1\n"));
  EXPECT_EQ(manager.next(1000), "READY=1") << "it goes on with what it has";
  EXPECT_EQ(counters()["configuration.reloads"], 1U);
  EXPECT_EQ(counters()["configuration.reload_failures"], 1U);
}

// --- Requests that are none ----------------------------------------------------------------------

TEST_F(ControllerTest, ABadRequestIsAnErrorThatCounts) {
  ASSERT_NO_FATAL_FAILURE(begin({}));
  const Json unknown = askFor("fly");
  EXPECT_TRUE(bad_request_);
  EXPECT_EQ(unknown["ok"], false);
  EXPECT_TRUE(unknown["error"].get<std::string>().starts_with("command: \"fly\" is not known"));
  EXPECT_EQ(ask("no json")["ok"], false);
  EXPECT_TRUE(bad_request_);
  EXPECT_EQ(askFor("status")["ok"], true);
  EXPECT_FALSE(bad_request_);
}

}  // namespace
}  // namespace waymark::daemon
