#include "capture/v4l2/controls.h"

#include <cstdint>
#include <optional>
#include <string>

#include <gtest/gtest.h>

namespace waymark::capture::v4l2 {
namespace {

const Control kGain{
    .id = 1, .name = "gain", .min = 0, .max = 100, .step = 5, .standard = 10, .menu = {}};
const Control kSwitch{.id = 2,
                      .name = "focus_automatic",
                      .kind = Control::Kind::kSwitch,
                      .max = 1,
                      .standard = 1,
                      .menu = {}};
const Control kExposure{.id = 3,
                        .name = "auto_exposure",
                        .kind = Control::Kind::kMenu,
                        .max = 3,
                        .standard = 3,
                        .menu = {{1, "Manual Mode"}, {3, "Aperture Priority Mode"}}};

std::string objectionTo(const Control& control, const ControlValue& asked) {
  std::string objection;
  return controlValue(control, asked, &objection) ? "" : objection;
}

std::optional<std::int64_t> valueOf(const Control& control, const ControlValue& asked) {
  std::string objection;
  return controlValue(control, asked, &objection);
}

TEST(Controls, NumbersWithinTheirRange) {
  EXPECT_EQ(valueOf(kGain, std::int64_t{35}), 35);
  const std::string range = "must be a whole number from 0 to 100 in steps of 5";
  EXPECT_EQ(objectionTo(kGain, std::int64_t{36}), range);
  EXPECT_EQ(objectionTo(kGain, std::int64_t{105}), range);
  EXPECT_EQ(objectionTo(kGain, true), range);
  EXPECT_EQ(objectionTo(kGain, 1.5), range);
  EXPECT_EQ(objectionTo(kGain, std::string("much")), range);
}

TEST(Controls, SwitchesAndMenusByNameAndNumber) {
  EXPECT_EQ(valueOf(kSwitch, false), 0);
  EXPECT_EQ(valueOf(kSwitch, std::int64_t{1}), 1);
  EXPECT_EQ(objectionTo(kSwitch, std::int64_t{2}), "must be true or false");
  EXPECT_EQ(valueOf(kExposure, std::int64_t{1}), 1);
  EXPECT_EQ(valueOf(kExposure, std::string("manual mode")), 1);
  EXPECT_EQ(valueOf(kExposure, std::string("aperture_priority_mode")), 3);
  EXPECT_EQ(objectionTo(kExposure, std::int64_t{2}),
            "must be one of 1 (Manual Mode), 3 (Aperture Priority Mode)");
}

TEST(Controls, AreDescribedForPeople) {
  EXPECT_EQ(describeControl(kGain, 20),
            "a whole number from 0 to 100 in steps of 5; default 10, is 20");
  EXPECT_EQ(describeControl(kSwitch, 1), "true or false; default true, is true");
}

}  // namespace
}  // namespace waymark::capture::v4l2
