#include "io/yaml_text.h"

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
}

TEST(YamlText, WhatIsNone) {
  for (const char* text : {"", "{[", "a: [1, 2\n", "\x01\x02"}) {
    const auto yaml = parseYaml(text, "f.yaml");
    ASSERT_FALSE(yaml) << text << yaml->dump();
    EXPECT_EQ(yaml.error().message, "f.yaml: is not YAML");
  }
}

}  // namespace
}  // namespace waymark::io
