#include "io/settings/settings_file.h"

#include <array>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

enum class Colour { kRed, kBlue };

struct Target {
  std::string name = "none";
  std::filesystem::path path;
  bool flag = false;
  int count = 4;
  std::uint64_t seed = 1;
  double length = 0.5;
  Colour colour = Colour::kRed;

  std::vector<Setting> settings() {
    const auto object = [](const std::string& text) -> ValidationError {
      if (text == "good") return {};
      return "is bad";
    };
    return {required(textSetting("a.name", name, object)),
            pathSetting("a.path", path),
            flagSetting("a.b.flag", flag),
            integerSetting("a.b.count", count, 1, 9),
            integerSetting("a.b.seed", seed, 0, 1'000'000'000'000),
            numberSetting("a.b.length", length, 0.5, 2.0, "m"),
            choiceSetting<Colour>("a.colour", colour,
                                  {{"red", Colour::kRed}, {"blue", Colour::kBlue}})};
  }
};

std::string errorOf(const std::string& text) {
  Target target;
  const Status status = readSettings(text, "w.toml", target.settings());
  return status ? "no error" : status.error().message;
}

TEST(SettingsFile, AnyDepth) {
  std::string dots = "a";
  for (int i = 0; i < 100; ++i) dots += ".a";
  EXPECT_EQ(errorOf(dots + ".a = 1\n"), "w.toml:1:202: has too many dots");
  // As deep as it gets.
  std::string deep = dots + " = ";
  for (int i = 0; i < 250; ++i) deep += "[\n{" + dots + " = ";
  EXPECT_NE(errorOf(deep), "no error");
  for (int i = 0; i < 1'000'000; ++i) deep += "[\n";
  EXPECT_NE(errorOf(deep), "no error");
}

TEST(SettingsFile, ErrorsAreOneLine) {
  EXPECT_EQ(errorOf("\"b\\nc\" = 1\n"), "w.toml:1:1: b c: unknown key");
}

TEST(SettingsFile, ReadsEveryKindOfValue) {
  Target t;
  const Status status = readSettings(
      "[a]\nname = 'good'\npath = 'x/y'\ncolour = 'blue'\n"
      "[a.b]\nflag = true\ncount = 9\nseed = 123456789012\nlength = 1\n",
      "w.toml", t.settings());
  ASSERT_TRUE(status) << status.error().message;
  EXPECT_EQ(t.name, "good");
  EXPECT_EQ(t.path, "x/y");
  EXPECT_TRUE(t.flag);
  EXPECT_EQ(t.count, 9);
  EXPECT_EQ(t.seed, 123456789012U);
  EXPECT_EQ(t.length, 1.0);
  EXPECT_EQ(t.colour, Colour::kBlue);
}

TEST(SettingsFile, WhatIsNotThereStaysAsItWas) {
  Target t;
  ASSERT_TRUE(readSettings("a.name = 'good'\n", "w.toml", t.settings()));
  EXPECT_EQ(t.count, 4);
  EXPECT_EQ(t.length, 0.5);
}

TEST(SettingsFile, ErrorsNamePlaceKeyAndReason) {
  const std::string good = "[a]\nname = 'good'\n";
  EXPECT_EQ(errorOf(good), "no error");
  EXPECT_EQ(errorOf("[a]\nname = 'other'\n"), "w.toml:2:8: a.name: is bad");
  EXPECT_EQ(errorOf("[a]\nname = ''\n"), "w.toml:2:8: a.name: must not be empty");
  EXPECT_EQ(errorOf("[a]\nname = 3\n"), "w.toml:2:8: a.name: must be text in quotes");
  EXPECT_EQ(errorOf("[a]\n"), "w.toml: a.name: missing");
  EXPECT_EQ(errorOf(good + "path = false\n"), "w.toml:3:8: a.path: must be text in quotes");
  EXPECT_EQ(errorOf(good + "b.flag = 1\n"), "w.toml:3:10: a.b.flag: must be true or false");
  EXPECT_EQ(errorOf(good + "b.count = 1.0\n"), "w.toml:3:11: a.b.count: must be a whole number");
  EXPECT_EQ(errorOf(good + "b.count = 10\n"),
            "w.toml:3:11: a.b.count: must be from 1 to 9, not 10");
  EXPECT_EQ(errorOf(good + "b.seed = -1\n"),
            "w.toml:3:10: a.b.seed: must be from 0 to 1000000000000, not -1");
  EXPECT_EQ(errorOf(good + "b.length = 'long'\n"), "w.toml:3:12: a.b.length: must be a number");
  EXPECT_EQ(errorOf(good + "b.length = nan\n"),
            "w.toml:3:12: a.b.length: must be from 0.5 to 2 m, not nan");
  EXPECT_EQ(errorOf(good + "colour = 'green'\n"),
            "w.toml:3:10: a.colour: must be one of \"red\", \"blue\"");
  EXPECT_EQ(errorOf(good + "c = 1\n"), "w.toml:3:1: a.c: unknown key");
  EXPECT_EQ(errorOf(good + "b = 1\n"), "w.toml:3:5: a.b: must be a section");
  EXPECT_EQ(errorOf(good + "[other]\n"), "w.toml:3:2: other: unknown key");
}

TEST(SettingsFile, SyntaxErrorsAreOneLineWithTheirPlace) {
  const std::string message = errorOf("[a]\nname = 'good\n");
  EXPECT_TRUE(message.starts_with("w.toml:2:")) << message;
  EXPECT_EQ(message.find('\n'), message.npos);
}

TEST(SettingsFile, SectionsOfOthersArePassedOver) {
  constexpr std::array<std::string_view, 1> kOthers = {"other"};
  Target t;
  const auto settings = t.settings();
  EXPECT_TRUE(readSettings("[other]\nx = 1\n[a]\nname = 'good'\n", "w.toml", settings, kOthers));
  // Neither a key of that name nor a section of it further in.
  EXPECT_FALSE(readSettings("other = 1\n[a]\nname = 'good'\n", "w.toml", settings, kOthers));
  EXPECT_FALSE(readSettings("[a]\nname = 'good'\n[a.other]\n", "w.toml", settings, kOthers));
}

TEST(SettingsFile, AFreeSectionTakesAnyKey) {
  std::map<std::string, FreeValue> values;
  const std::vector<Setting> settings = {freeSection("a.free", values)};
  const auto read = [&](const std::string& text) {
    const Status status = readSettings(text, "s.toml", settings);
    return status ? "no error" : status.error().message;
  };
  EXPECT_EQ(read("[a.free]\ngain = 3\nauto = false\nshare = 0.5\nmode = 'slow'\n"), "no error");
  EXPECT_EQ(values, (std::map<std::string, FreeValue>{{"auto", false},
                                                      {"gain", std::int64_t{3}},
                                                      {"mode", std::string("slow")},
                                                      {"share", 0.5}}));
  EXPECT_EQ(read("a.free = 3\n"), "s.toml:1:10: a.free: must be a section");
  EXPECT_EQ(read("[a.free]\ngain = [1]\n"),
            "s.toml:1:1: a.free: gain must be a number, true or false, or text");
}

TEST(SettingsFile, WhatHasChangedBetweenTwoTexts) {
  const std::string text = "[a]\nname = 'x'\n[a.b]\ncount = 4 # four\nlist = [1, 2]\n";
  const auto changed = [&](const std::string& other) {
    return changedSettings(settingTexts(text), settingTexts(other));
  };
  using Keys = std::vector<std::string>;
  EXPECT_EQ(changed("a.b = { list = [ 1,2 ], count = 4 }\na.name = \"x\"\n"), Keys{});
  EXPECT_EQ(changed("[a]\nname = 'y'\n[a.b]\ncount = 4\nlist = [2, 1]\n"),
            (Keys{"a.b.list", "a.name"}));
  EXPECT_EQ(changed("[a]\nname = 'x'\nother = true\n[a.b]\nlist = [1, 2]\n"),
            (Keys{"a.b.count", "a.other"}));
  const std::string sections = "[[s]]\nid = 1\n[[s]]\nid = 2\n";
  EXPECT_EQ(changedSettings(settingTexts(sections), settingTexts(sections)), Keys{});
  EXPECT_EQ(changedSettings(settingTexts(sections), settingTexts("[[s]]\nid = 1\n")), Keys{"s"});
}

TEST(SettingsFile, PathsCountFromTheFile) {
  EXPECT_EQ(besideFile("/etc/w.toml", "calib.yml"), "/etc/calib.yml");
  EXPECT_EQ(besideFile("/etc/w.toml", "/home/calib.yml"), "/home/calib.yml");
  EXPECT_EQ(besideFile("w.toml", "calib.yml"), "calib.yml");
}

}  // namespace
}  // namespace waymark::io
