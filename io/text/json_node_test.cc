#include "io/text/json_node.h"

#include <functional>
#include <random>
#include <string>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

std::string faultOf(const std::string& text, const std::function<void(const JsonNode&)>& read) {
  const Result<Json> json = parseJson(text, "f.json");
  if (!json) return json.error().message;
  std::string fault;
  read(JsonNode(*json, &fault));
  return fault;
}

TEST(JsonNode, SyntaxErrorsNameLineAndColumn) {
  const auto nothing = [](const JsonNode&) {};
  EXPECT_EQ(faultOf("{\"a\":1,\n \"b\":}", nothing), "f.json:2:6: is not JSON");
  EXPECT_EQ(faultOf("{\"a\":[1,", nothing), "f.json:1:9: is not JSON: it is cut off here");
  EXPECT_EQ(faultOf("", nothing), "f.json:1:1: is not JSON: it is cut off here");
  EXPECT_EQ(faultOf("{\"a\":1e999}", nothing), "f.json: has a number that is too large");
}

TEST(JsonNode, AnyDepthAndAnyNumberOfKeys) {
  const auto nothing = [](const JsonNode&) {};
  const std::string reason = "is nested too deeply or has too many keys";
  const std::string lists(1'000'000, '[');
  EXPECT_EQ(faultOf(lists, nothing), "f.json:1:101: " + reason);
  EXPECT_EQ(faultOf("{\"]\\\"]\":\n" + lists, nothing), "f.json:2:100: " + reason);
  std::string keys = "{\"a\":0";
  for (int i = 0; i < 1000; ++i) keys += ",\"" + std::to_string(i) + "\":0";
  EXPECT_NE(faultOf(keys + "}", nothing).find(reason), std::string::npos);
}

TEST(JsonNode, FaultsNameThePlace) {
  const std::string text = R"({"a":[{"b":1},{"b":"x","n":-1,"p":[1,2]}],"q":[1,1,0,0]})";
  const auto second = [](const JsonNode& root) { return root.at("a").elements()[1]; };
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("b").number(); }),
            "a[1].b: must be a number");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("c").number(); }),
            "a[1].c: is missing");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("n").positive(); }),
            "a[1].n: must be positive");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("n").natural(); }),
            "a[1].n: must be a whole number from 0 on");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("n").integer(0, 9); }),
            "a[1].n: must be a whole number from 0 to 9");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)second(r).at("p").point3(); }),
            "a[1].p: must be a list of 3");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)r.at("q").unitQuaternion(); }),
            "q: must have length 1");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)r.at("q").at("x").number(); }),
            "q: must be an object {...}");
  EXPECT_EQ(faultOf(text, [&](auto& r) { (void)r.at("q").text(); }), "q: must be text");
}

TEST(JsonNode, TheFirstFaultIsKept) {
  EXPECT_EQ(faultOf("{}",
                    [](auto& root) {
                      (void)root.at("a").number();
                      (void)root.at("b").number();
                    }),
            "a: is missing");
}

TEST(JsonNode, WhatIsWrittenReadsBackForEver) {
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 20'000; ++i) {
    Eigen::Quaterniond random(normal(rng), normal(rng), normal(rng), normal(rng));
    if (i % 3 == 0) random.w() = 0.0;  // half turns: w changes its sign easily
    if (i % 5 == 0) random.x() = random.y() = 0.0;
    random.normalize();
    const slam::Transform T = slam::Transform::fromQuaternion(random, {normal(rng), 1.0, -0.0});
    const std::string text = toJson(T).dump();
    const Json json = Json::parse(text);
    std::string fault;
    const slam::Transform back = JsonNode(json, &fault).transform();
    ASSERT_EQ(fault, "");
    ASSERT_EQ(toJson(back).dump(), text);
    ASSERT_EQ(back.R, asRead(T).R);
    ASSERT_LT((back.R - T.R).norm(), 1e-13);
  }
}

}  // namespace
}  // namespace waymark::io
