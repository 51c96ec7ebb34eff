// The page of waymark-view in a browser.
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/browser.h"
#include "tests/pretended_daemon.h"
#include "tests/process.h"
#include "tests/running_view.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

class ViewPageTest : public ViewTest {
 protected:
  // For people: into the directory WAYMARK_PICTURES, where there is one.
  static void keepPicture(Browser& browser, const std::string& name) {
    const char* const keep = std::getenv("WAYMARK_PICTURES");
    if (keep != nullptr) browser.screenshot(fs::path(keep) / (name + ".png"));
  }
};

constexpr const char* kText = "document.getElementById('state').textContent";

TEST_F(ViewPageTest, ThePageShowsTheMapAndFollowsTheDaemon) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  view();
  auto daemon = std::make_unique<PretendedDaemon>(url_, "TEST_");
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers === 48"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().pictures === 2"));
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().segments > 50")) << "it moves";
  EXPECT_EQ(browser->evaluate("document.querySelectorAll('#markers tbody tr').length"), 51);
  for (const char* natural :
       {"document.getElementById('legend').textContent.includes('natural marker')",
        "document.getElementById('markers').textContent.includes('posternatural, 0.600')",
        "document.getElementById('map-text').textContent.includes('2 natural ones')"}) {
    EXPECT_EQ(browser->evaluate(natural), true) << natural;
  }
  // It goes round: the second one comes into view, and nobody finds it there.
  EXPECT_TRUE(
      browser->becomes("document.getElementById('image-text').textContent.includes('natural "
                       "markers (fire exit plan), dashed: not found within a second')"));
  EXPECT_TRUE(browser->becomes(
      "document.getElementById('image-text').textContent.includes('natural markers (poster')"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('counters').textContent.includes("
                       "'dropped.queue') && document.getElementById('counters')."
                       "textContent.includes('the SLAM loop is late')"));
  EXPECT_EQ(browser->evaluate("document.getElementById('buttons').hidden"), true)
      << "it only looks";

  // In light and dark, on a desk and in a hand; by keys.
  for (const bool phone : {false, true}) {
    browser->resize(phone ? 390 : 1280, phone ? 844 : 800, phone);
    for (const bool dark : {false, true}) {
      browser->dark(dark);
      std::this_thread::sleep_for(milliseconds(700));
      const fs::path file = directory_ / "picture.png";
      browser->screenshot(file);
      const cv::Mat picture = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
      ASSERT_FALSE(picture.empty());
      cv::Scalar mean, scatter;
      cv::meanStdDev(picture, mean, scatter);
      EXPECT_GT(scatter[0], 15.0) << "there is something on it";
      EXPECT_EQ(mean[0] < 110.0, dark);
      keepPicture(*browser, std::string(phone ? "phone" : "desk") + (dark ? "_dark" : "_light"));
    }
    EXPECT_LE(browser->evaluate("document.documentElement.scrollWidth - innerWidth"), 0)
        << "nothing hangs over the side";
  }
  browser->press("u");
  EXPECT_EQ(browser->evaluate("document.getElementById('sigma').getAttribute('aria-pressed')"),
            "true");

  daemon->no_camera = true;
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no camera'"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('why').textContent.startsWith("
                       "'/dev/video0: unplugged')"));
  // The daemon goes, and another one comes.
  daemon.reset();
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no daemon'"));
  daemon = std::make_unique<PretendedDaemon>(url_, "TEST_");
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
  // So does what serves the page.
  view_->signal(SIGTERM);
  EXPECT_EQ(view_->wait(milliseconds(5000)), 0);
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'no connection'"));
  view();
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers === 48"));
}

TEST_F(ViewPageTest, ButtonsDoWhatTheySay) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(400, 300, false);  // a small map leaves the daemon some of the processor
  start(configuration("", "[record]\ndirectory = 'logs'\nat_start = false\n"));
  view({"--allow-control"});
  browser->open(address());
  ASSERT_TRUE(browser->becomes("document.getElementById('buttons').hidden === false"));
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'tracking'"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 2"));
  const auto button = [](const std::string& command) {
    return "document.querySelector('[data-command=" + command + "]')";
  };
  const auto recorder = [&] { return status()["recorder"]["state"].get<std::string>(); };
  EXPECT_TRUE(browser->becomes(button("record-stop") + ".disabled"));
  browser->evaluate(button("record-start") + ".click()");
  EXPECT_TRUE(browser->becomes("document.getElementById('answer').textContent === 'done'", 60));
  EXPECT_TRUE(eventually([&] { return recorder() == "recording"; }));
  EXPECT_TRUE(browser->becomes(button("record-start") + ".disabled"));
  browser->evaluate(button("record-stop") + ".click()");
  EXPECT_TRUE(eventually([&] { return recorder() != "recording"; }));
  browser->evaluate(button("save-map") + ".click()");
  EXPECT_TRUE(eventually([&] { return fs::exists(map_); }));
  // What cannot be undone asks before.
  browser->evaluate("window.asked = 0; window.confirm = () => { ++window.asked; return false; }");
  browser->evaluate(button("reset") + ".click()");
  EXPECT_EQ(browser->evaluate("window.asked"), 1);
  EXPECT_EQ(counter("map.resets"), 0) << "somebody thought better of it";
  browser->evaluate("window.confirm = () => true");
  browser->evaluate(button("reset") + ".click()");
  EXPECT_TRUE(reaches("map.resets", 1));
  browser->evaluate(button("load-map") + ".click()");
  EXPECT_TRUE(reaches("map.loads", 1));
  // The lens is for whoever looks: a file that the browser keeps.
  EXPECT_TRUE(browser->becomes("document.getElementById('lens').hidden === false"));
  browser->evaluate(
      "fetch(document.getElementById('save-calibration').href).then((r) => r.text()).then((t) => { "
      "window.lens = t; })");
  EXPECT_TRUE(browser->becomes("window.lens && window.lens.includes('camera_matrix')"));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
}

// Of a real daemon: only while somebody looks, with what was found in the same frame.
TEST_F(ViewPageTest, TheLiveImageStandsUnderWhatWasFoundInIt) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(400, 300, false);  // a small map leaves the daemon some of the processor
  start(configuration());
  view();
  EXPECT_EQ(counter("preview.sent"), 0) << "nobody looks";
  browser->open(address());
  const std::string image = "document.getElementById('image')";
  EXPECT_TRUE(browser->becomes("Number(" + image + ".dataset.image) > 0", 60));
  // Light paper: there is more in it than markers alone.
  EXPECT_TRUE(browser->becomes(
      "(() => { const p = " + image + ".getContext('2d').getImageData(0, 0, " + image + ".width, " +
      image +
      ".height).data; let n = 0; for (let i = 0; i < p.length; i += 4) "
      "if (p[i + 3] === 255 && p[i] > 60) ++n; return n > 0.5 * p.length / 4; })()"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('image-text').textContent.includes("
                       "'residual in pixels')"));
  EXPECT_TRUE(eventually([&] { return counter("preview.sent") >= 5; }));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
}

// Somebody moves a board about in front of a camera that knows nothing yet.
TEST_F(ViewPageTest, WhoCalibratesIsToldWhatIsMissing) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(500, 600, false);
  const std::string scene = (directory_ / "board").string();
  ASSERT_EQ(runProgram({WAYMARK_PROGRAM, "simulate", "board", "--out", scene, "--duration", "8",
                        "--fps", "10", "--size", "640x480", "--quiet"})
                .exit_code,
            0);
  view();
  browser->open(address());
  const auto calibrate = [&] {
    return std::make_unique<Process>(
        std::vector<std::string>{WAYMARK_PROGRAM, "calibrate", scene + "/frames.avi", "--realtime",
                                 "--fps", "4", "--board", "charuco", "--url", url_,
                                 "--channel-prefix", "TEST_", "--out",
                                 (directory_ / "lens").string()},
        directory_ / "calibrate.err", directory_ / "calibrate.out");
  };
  const auto running = calibrate();
  EXPECT_TRUE(browser->becomes(std::string(kText) + " === 'calibrating'")) << running->stderrText();
  EXPECT_TRUE(browser->becomes(
      "document.getElementById('advice').textContent.startsWith('Bring it there in the image: ')"));
  EXPECT_TRUE(
      browser->becomes("document.getElementById('image-text').textContent.includes('points of the "
                       "board (dots); where it is veiled, the board has not been yet')"));
  EXPECT_EQ(browser->evaluate("document.getElementById('scene').offsetParent"), nullptr)
      << "there is no map to look at";
  keepPicture(*browser, "calibrate");
  running->signal(SIGINT);
  EXPECT_TRUE(running->wait(milliseconds(60'000)).has_value());
  EXPECT_TRUE(browser->becomes("document.getElementById('calibration-section').hidden === true"))
      << "it is over";
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
}

// What is over: results of a run with the truth, and a recording of a daemon.
TEST_F(ViewPageTest, ResultsAndRecordingsAreShownWithATimeLine) {
  const auto browser = Browser::start(directory_.path());
  if (!browser) GTEST_SKIP() << "no chromium";
  browser->resize(500, 400, false);
  const std::string scene = (directory_ / "walls").string();
  const std::string result = (directory_ / "result").string();
  ASSERT_EQ(runProgram({WAYMARK_PROGRAM, "simulate", "walls", "--out", scene, "--duration", "4",
                        "--fps", "15", "--size", "320x240", "--quiet"})
                .exit_code,
            0);
  ASSERT_EQ(runProgram({WAYMARK_PROGRAM, "run", scene + "/frames.avi", "--calibration",
                        scene + "/calib.yml", "--dictionary", "ARUCO_MIP_36h12", "--marker-size",
                        "0.123", "--out", result, "--quiet"})
                .exit_code,
            0);
  view({result, "--truth", scene + "/gt_traj.txt"});
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().tracks === 3"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 10"));
  EXPECT_TRUE(browser->becomes(
      "document.getElementById('offline-errors').textContent.includes('ATE, live')"));
  EXPECT_EQ(browser->evaluate("document.getElementById('buttons').offsetParent"), nullptr)
      << "there is no daemon to tell anything";
  // The pose that is shown is the one of the time.
  const std::string time = "document.getElementById('time')";
  const std::string position = "document.getElementById('pose').textContent";
  EXPECT_TRUE(browser->becomes(position + ".includes('0.000  0.000')"));
  browser->evaluate(time + ".value = 1.5; " + time + ".dispatchEvent(new Event('input'))");
  EXPECT_TRUE(browser->becomes(position + ".includes('Frame22')"));
  browser->press(" ");
  EXPECT_TRUE(browser->becomes("WaymarkOffline.time() > 1.8"));
  EXPECT_TRUE(browser->errors().empty()) << browser->errors().front();
  view_->signal(SIGTERM);
  EXPECT_EQ(view_->wait(milliseconds(5000)), 0);

  start(configuration("", "[record]\ndirectory = 'logs'\n"));
  // A busy computer takes longer for as many.
  EXPECT_TRUE(eventually([&] { return counter("published.poses") >= 150; }));
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(milliseconds(20'000)), 0);
  const fs::path log = *fs::directory_iterator(directory_ / "logs");
  port_ = 0;
  view({log.string()});
  std::this_thread::sleep_for(milliseconds(6000));  // it does not begin before somebody looks
  browser->open(address());
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().segments > 20"));
  EXPECT_TRUE(browser->becomes("Number(document.getElementById('image').dataset.image) > 0"));
  EXPECT_TRUE(browser->becomes("WaymarkScene.counts().markers > 2"));
  browser->evaluate(time + ".value = 1; " + time + ".dispatchEvent(new Event('change'))");
  browser->evaluate("document.getElementById('play').click()");
  EXPECT_TRUE(browser->becomes("WaymarkOffline.time() > 0.9"));
  browser->evaluate("document.getElementById('play').click()");
  std::this_thread::sleep_for(milliseconds(3000));
  EXPECT_EQ(browser->evaluate("document.getElementById('image').dataset.image !== ''"), true)
      << "an image stays while the recording stands";
  for (const std::string& error : browser->errors()) {
    EXPECT_NE(error.find("ERR_CONNECTION_REFUSED"), std::string::npos)
        << "while there was none that served: " << error;
  }
}

}  // namespace
}  // namespace waymark::testing
