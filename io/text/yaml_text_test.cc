#include "io/text/yaml_text.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

TEST(YamlText, MapsListsNumbersAndText) {
  const auto yaml = parseYaml(
      "a: 1   # one\nb: 2.5\nc: word # and a comment\nd: \"quoted text\"\n"
      "list:\n  - x: 1\n    y: [1, 2.5]\n  - {x: 3}\n",
      "f.yaml");
  ASSERT_TRUE(yaml) << yaml.error().message;
  EXPECT_EQ(yaml->dump(),
            R"({"a":1,"b":2.5,"c":"word","d":"quoted text","list":[{"x":1,"y":[1,2.5]},{"x":3}]})");
}

TEST(YamlText, HeadAsOpenCvWritesIt) {
  const auto yaml = parseYaml("%YAML:1.0\n---\na: 1\n", "f.yaml");
  ASSERT_TRUE(yaml) << yaml.error().message;
  EXPECT_EQ(yaml->dump(), R"({"a":1})");
  // Lines keep their numbers.
  EXPECT_EQ(parseYaml("%YAML:1.0\n---\na: [1, 2\n", "f.yaml").error().message.find("f.yaml:4:1: "),
            0U);
}

TEST(YamlText, MapsAsOpenCvWritesThem) {
  const auto yaml = parseYaml(
      "%YAML:1.0\n---\nurl: \"a,b:c\"\nm: !!opencv-matrix\n   rows: 1\n"
      "l:\n   - { id:0, corners:[ [ 5., -1.5e-01 ], [\n       1, 2 ] ], name:\"a:b\" }\n"
      "   - {id:1,\n      size:.5, at:{x:1}}\n",
      "f.yaml");
  ASSERT_TRUE(yaml) << yaml.error().message;
  EXPECT_EQ(yaml->dump(),
            R"({"url":"a,b:c","m":{"rows":1},"l":[{"id":0,"corners":[[5.0,-0.15],[1,2]],)"
            R"("name":"a:b"},{"id":1,"size":0.5,"at":{"x":1}}]})");
}

TEST(YamlText, AnyDepth) {
  for (const char* step : {"[", "{a: ", "- ", "? "}) {
    std::string deep;
    for (int i = 0; i < 100'000; ++i) deep += step;
    for (const std::string& text : {deep, "%YAML:1.0\n---\na:\n  " + deep}) {
      EXPECT_FALSE(parseYaml(text, "f.yaml")) << step;
    }
  }
}

TEST(YamlText, ListsAsDeepAsTheirKey) {
  const auto yaml = parseYaml("a:\n- 1\n- 2.\nb:\n- [1,\n   -2e-1]\n", "f.yaml");
  ASSERT_TRUE(yaml) << yaml.error().message;
  EXPECT_EQ(yaml->dump(), R"({"a":[1,2.0],"b":[[1,-0.2]]})");
}

TEST(YamlText, QuotedNumbersAndWordsAreText) {
  const auto yaml = parseYaml("a: '1'\nb: true\nc: .nan\nd: !!str 2\ne: !!thing [1]\nf:\n", "f");
  ASSERT_TRUE(yaml) << yaml.error().message;
  EXPECT_EQ(yaml->dump(), R"({"a":"1","b":"true","c":".nan","d":"2","e":[1],"f":null})");
}

TEST(YamlText, WhatIsNone) {
  for (const char* text : {"", "hello", "{[", "a: [1, 2\n", "\x01\x02"}) {
    const auto yaml = parseYaml(text, "f.yaml");
    ASSERT_FALSE(yaml) << text << yaml->dump();
    EXPECT_EQ(yaml.error().message.find("f.yaml:"), 0U) << yaml.error().message;
    EXPECT_NE(yaml.error().message.find("is not YAML"), std::string::npos);
  }
  EXPECT_EQ(parseYaml("a: 1\nb: [1, 2\n", "f.yaml").error().message.find("f.yaml:3:1: "), 0U);
}

TEST(YamlText, FilesWithoutEnd) {
  std::string bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (char c = 'b'; c < 'l'; ++c) {
    const std::string before = std::string("*") + static_cast<char>(c - 1);
    bomb += std::string(1, c) + ": &" + c + " [" + before;
    for (int i = 0; i < 7; ++i) bomb += ", " + before;
    bomb += "]\n";
  }
  for (const std::string& text : {bomb, std::string("a: &a [*a]\n")}) {
    const auto yaml = parseYaml(text, "f.yaml");
    ASSERT_FALSE(yaml);
    EXPECT_EQ(yaml.error().message, "f.yaml: is nested too deeply or too large");
  }
}

}  // namespace
}  // namespace waymark::io
