#include "io/pictures/natural_marker_file.h"

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

std::string fileWith(const std::string& marker) {
  return R"({"format":"natural-markers","version":1,"markers":[)" + marker + "]}";
}

std::string faultOf(const std::string& text) {
  const auto entries = parseNaturalMarkers(text, "n.json");
  return entries ? std::string() : entries.error().message;
}

TEST(NaturalMarkerFile, ReadsWhatTheInterfaceSays) {
  const auto entries = parseNaturalMarkers(
      fileWith(R"({"name":"door","image":"prints/door.png","width":0.4,"note":"ignored"},)"
               R"({"name":"hall","image":"hall.jpg","width":0.5,"height":0.3,)"
               R"("T_w_m":{"p":[1,2,3],"q":[1,0,0,0]}})"),
      "n.json");
  ASSERT_TRUE(entries) << entries.error().message;
  ASSERT_EQ(entries->size(), 2U);
  EXPECT_EQ((*entries)[0].name, "door");
  EXPECT_EQ((*entries)[0].image, "prints/door.png");
  EXPECT_EQ((*entries)[0].height_m, 0.0);
  EXPECT_FALSE((*entries)[0].T_w_m);
  EXPECT_EQ((*entries)[1].height_m, 0.3);
  ASSERT_TRUE((*entries)[1].T_w_m);
  EXPECT_EQ((*entries)[1].T_w_m->p.z(), 3.0);
}

TEST(NaturalMarkerFile, FaultsNameTheirPlace) {
  EXPECT_NE(faultOf(fileWith(R"({"name":"a","image":"a.png"})")).find("width"), std::string::npos);
  EXPECT_EQ(faultOf(fileWith(R"({"name":"a","image":"a.png","width":-1})")).find("n.json: "), 0U);
  EXPECT_NE(faultOf(fileWith(R"({"name":"a","image":"a.png","width":1e9})")).find("1000 m"),
            std::string::npos);
  EXPECT_NE(faultOf(fileWith(R"({"name":"a","image":"a.png","width":1},)"
                             R"({"name":"a","image":"b.png","width":1})"))
                .find("twice"),
            std::string::npos);
  EXPECT_NE(faultOf(R"({"format":"waymark-map","version":1,"markers":[]})").find("waymark-map"),
            std::string::npos);
  EXPECT_FALSE(faultOf(R"({"format":"natural-markers","version":2,"markers":[]})").empty());
  EXPECT_FALSE(faultOf(R"({"format":"natural-markers",)").empty());
  EXPECT_FALSE(faultOf(fileWith(R"({"name":"a","image":"a.png","width":1,)"
                                R"("T_w_m":{"p":[0,0,0],"q":[2,0,0,0]}})"))
                   .empty());
  EXPECT_NE(faultOf("\x89PNG\r\n\x1a\n ...").find("is an image"), std::string::npos);
}

TEST(NaturalMarkerFile, AddsOneAndKeepsTheRest) {
  const NaturalMarkerEntry door{"door", "door.png", 0.4, 0.0, {}};
  const auto first = withNaturalMarker("", "n.json", door);
  ASSERT_TRUE(first) << first.error().message;
  const std::string noted = R"({"format":"natural-markers","version":1,"site":"hall 3","markers":)"
                            R"([{"name":"x","image":"x.png","width":1,"floor":2}]})";
  slam::Transform T;
  T.p = {1.0, 2.0, 0.5};
  const auto second = withNaturalMarker(noted, "n.json", {"door", "door.png", 0.4, 0.3, T});
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_NE(second->find("hall 3"), std::string::npos);
  EXPECT_NE(second->find("floor"), std::string::npos);
  const auto entries = parseNaturalMarkers(*second, "n.json");
  ASSERT_TRUE(entries);
  ASSERT_EQ(entries->size(), 2U);
  EXPECT_EQ((*entries)[1].T_w_m->p, T.p);
  EXPECT_EQ((*entries)[1].height_m, 0.3);
  EXPECT_FALSE(withNaturalMarker(*second, "n.json", door));  // the name is taken
  EXPECT_FALSE(withNaturalMarker("{", "n.json", door));
}

}  // namespace
}  // namespace waymark::io
