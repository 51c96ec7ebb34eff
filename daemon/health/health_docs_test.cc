// docs/health.md against the tables that health messages are made of.
#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include <gtest/gtest.h>

#include "capture/frame_source.h"
#include "daemon/frames/stage_clock.h"
#include "slam/counters.h"

namespace waymark::daemon {
namespace {

std::string healthPage() {
  std::ifstream file(WAYMARK_HEALTH_PAGE);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A line of a table: "| `slam.frames` | frames processed |".
std::string row(const std::string& counter, const std::string& counts) {
  return "\n| `" + counter + "` | " + counts + " |";
}

TEST(HealthPage, HasEveryCounterOfTheSlam) {
  const std::string page = healthPage();
  for (const slam::NamedCounter& counter : slam::kCounters) {
    const std::string expected = row(std::string("slam.") + counter.name, counter.counts);
    EXPECT_NE(page.find(expected), page.npos) << expected;
  }
}

TEST(HealthPage, HasTheMissedDeadlinesOfEveryStage) {
  const std::string page = healthPage();
  for (const slam::NamedStage& stage : kFrameStages) {
    const std::string expected = row(std::string("deadline.missed_") + stage.name, stage.does);
    EXPECT_NE(page.find(expected), page.npos) << expected;
  }
}

TEST(HealthPage, HasEveryCounterOfTheSource) {
  const std::string page = healthPage();
  for (const capture::NamedSourceCounter& counter : capture::kSourceCounters) {
    EXPECT_NE(page.find("`" + std::string(counter.name) + "`"), page.npos) << counter.name;
  }
}

TEST(Counters, EachHasANameOfItsOwn) {
  std::set<std::string> names;
  for (const slam::NamedCounter& counter : slam::kCounters) names.insert(counter.name);
  EXPECT_EQ(names.size(), slam::kCounters.size());
  std::set<std::string> stages;
  for (const slam::NamedStage& stage : kFrameStages) stages.insert(stage.name);
  EXPECT_EQ(stages.size(), kFrameStages.size());
}

TEST(Counters, EachMemberIsInTheTableOnce) {
  slam::Counters one;
  for (const slam::NamedCounter& counter : slam::kCounters) one.*counter.value += 1;
  const slam::Counters three = one + one + one;
  for (const slam::NamedCounter& counter : slam::kCounters) {
    EXPECT_EQ(three.*counter.value, 3U) << counter.name;
  }
}

}  // namespace
}  // namespace waymark::daemon
