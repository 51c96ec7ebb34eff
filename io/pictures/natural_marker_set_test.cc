#include "io/pictures/natural_marker_set.h"

#include <filesystem>
#include <fstream>
#include <random>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "io/pictures/feature_cache.h"
#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

cv::Mat scribbles(unsigned seed, int width = 400, int height = 300) {
  cv::RNG rng(seed);
  cv::Mat image(height, width, CV_8U, cv::Scalar(120));
  for (int i = 0; i < 90; ++i) {
    const cv::Point at(rng.uniform(0, width), rng.uniform(0, height));
    cv::circle(image, at, rng.uniform(2, width / 8), cv::Scalar::all(rng.uniform(0, 255)),
               cv::FILLED, cv::LINE_AA);
  }
  return image;
}

class NaturalMarkerSetTest : public ::testing::Test {
 protected:
  void save(const std::string& name, const cv::Mat& image) {
    ASSERT_TRUE(cv::imwrite((directory_ / name).string(), image));
  }
  // a.png and b.png; mixed.png is most of the one and some of the other.
  void saveAlike() {
    cv::Mat mixed = scribbles(1);
    const cv::Mat other = scribbles(2);
    save("a.png", mixed);
    save("b.png", other);
    other.colRange(250, 400).copyTo(mixed.colRange(250, 400));
    save("mixed.png", mixed);
  }
  // A file of these images, each 0.3 m wide.
  std::filesystem::path file(const std::vector<std::string>& images) {
    std::string text;
    for (const std::string& image : images) {
      const std::string name = std::to_string(++named_);
      const auto more = withNaturalMarker(text, "n.json", {name, image, 0.3, 0.0, {}});
      EXPECT_TRUE(more) << more.error().message;
      text = *more;
    }
    const std::filesystem::path path = directory_ / "n.json";
    EXPECT_TRUE(writeTextFile(path, text));
    return path;
  }
  std::string faultOf(const std::vector<std::string>& images) {
    const auto set = readNaturalMarkers(file(images));
    return set ? std::string() : set.error().message;
  }

  testing::TemporaryDirectory directory_;
  int named_ = 0;
};

TEST_F(NaturalMarkerSetTest, FeaturesAreComputedOnce) {
  save("a.png", scribbles(1));
  save("b.jpg", scribbles(2));
  const std::filesystem::path path = file({"a.png", "b.jpg"});
  const auto first = readNaturalMarkers(path);
  ASSERT_TRUE(first) << first.error().message;
  EXPECT_EQ(first->markers.size(), 2U);
  EXPECT_EQ(first->computed, 2);
  const auto second = readNaturalMarkers(path);
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_EQ(second->computed, 0);
  EXPECT_EQ(second->markers[1].features().descriptors, first->markers[1].features().descriptors);
  EXPECT_EQ(second->markers[1].quality().distinct_features,
            first->markers[1].quality().distinct_features);
  // Another picture under the old name.
  save("b.jpg", scribbles(3));
  const auto third = readNaturalMarkers(path);
  ASSERT_TRUE(third) << third.error().message;
  EXPECT_EQ(third->computed, 1);
  // A cache that is damaged is made anew.
  std::ofstream(featureCachePath(path)) << "WMFEAT02 nonsense";
  const auto fourth = readNaturalMarkers(path);
  ASSERT_TRUE(fourth) << fourth.error().message;
  EXPECT_EQ(fourth->computed, 2);
}

TEST_F(NaturalMarkerSetTest, EachFaultIsOneLine) {
  save("good.png", scribbles(1));
  save("copy.png", scribbles(1));
  save("uniform.png", cv::Mat(300, 400, CV_8U, cv::Scalar(90)));
  save("small.png", scribbles(1, 40, 30));
  cv::Mat tiles;
  cv::repeat(scribbles(4, 40, 40), 12, 16, tiles);
  save("tiles.png", tiles);
  std::ofstream(directory_ / "no.png") << "this is no image";
  std::ofstream(directory_ / "empty.png");

  const auto says = [this](const std::string& image, const std::string& what) {
    const std::string fault = faultOf({"good.png", image});
    EXPECT_NE(fault.find(what), std::string::npos) << image << ": " << fault;
    EXPECT_NE(fault.find(image), std::string::npos) << fault;
    EXPECT_EQ(fault.find('\n'), std::string::npos) << fault;
  };
  says("uniform.png", "uniform");
  says("small.png", "too small");
  says("tiles.png", "self-similar");
  says("no.png", "no image");
  says("empty.png", "empty");
  says("missing.png", "No such file");
  says("copy.png", "same picture");
  EXPECT_EQ(faultOf({"good.png"}), "");
}

TEST_F(NaturalMarkerSetTest, LargePicturesAreReducedAndSaySo) {
  cv::Mat large;
  cv::resize(scribbles(5), large, cv::Size(8000, 6000));
  save("large.jpg", large);
  const auto set = readNaturalMarkers(file({"large.jpg"}));
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ(set->notes.size(), 1U);
  EXPECT_NE(set->notes[0].find("8000x6000"), std::string::npos) << set->notes[0];
}

TEST_F(NaturalMarkerSetTest, OnePictureSaysWhatOfItIsUsedAndWhichItIs) {
  cv::Mat large;
  cv::resize(scribbles(5), large, cv::Size(8000, 2000));
  save("large.jpg", large);
  save("small.png", scribbles(5));
  save("copy.png", scribbles(5));
  const auto large_one = readNaturalMarker(directory_ / "large.jpg", 2.0, 0.0);
  const auto small = readNaturalMarker(directory_ / "small.png", 0.3, 0.0);
  const auto copy = readNaturalMarker(directory_ / "copy.png", 0.4, 0.0);
  ASSERT_TRUE(large_one && small && copy);
  EXPECT_NE(large_one->note.find("large.jpg: has 8000x2000 pixels, of which 512x128 are used"),
            std::string::npos)
      << large_one->note;
  EXPECT_EQ(small->note, "");
  EXPECT_EQ(small->key, copy->key);
  EXPECT_NE(small->key, large_one->key);
  const auto set = readNaturalMarkers(file({"large.jpg", "small.png"}));
  ASSERT_TRUE(set) << set.error().message;
  EXPECT_EQ(set->keys, (std::vector<std::uint64_t>{large_one->key, small->key}));
}

TEST_F(NaturalMarkerSetTest, PicturesThatLookAlikeAreToldInOneLine) {
  saveAlike();
  const auto noteOf = [this](const std::vector<std::string>& images) {
    named_ = 0;
    const auto set = readNaturalMarkers(file(images));
    return set ? alikeNote(*set, "n.json") : set.error().message;
  };
  EXPECT_EQ(noteOf({"a.png", "b.png"}), "");
  const std::string note = noteOf({"a.png", "b.png", "mixed.png"});
  EXPECT_EQ(note.find("n.json: '1' and '3' look alike ("), 0U) << note;
  EXPECT_EQ(note.find('\n'), std::string::npos) << note;
}

// Looking for them takes longer than all else, the more the more pictures there are.
TEST_F(NaturalMarkerSetTest, WhichLookAlikeIsLookedForOnce) {
  saveAlike();
  const std::filesystem::path path = file({"mixed.png", "b.png", "a.png"});
  const std::filesystem::path cache_path = featureCachePath(path);
  const auto first = readNaturalMarkers(path);
  ASSERT_TRUE(first) << first.error().message;
  ASSERT_FALSE(first->alike.empty());
  // What is not looked for comes from the cache: here something that nobody would find.
  FeatureCache cache = parseFeatureCache(*readTextFile(cache_path));
  ASSERT_EQ(cache.alike.size(), first->alike.size());
  cache.alike = {{first->keys[2], first->keys[1], 123, 0.75}};
  ASSERT_TRUE(writeTextFile(cache_path, formatFeatureCache(cache)));
  const auto second = readNaturalMarkers(path);
  ASSERT_TRUE(second) << second.error().message;
  ASSERT_EQ(second->alike.size(), 1U);
  EXPECT_EQ(second->alike[0].first, 1);
  EXPECT_EQ(second->alike[0].second, 2);
  EXPECT_EQ(second->alike[0].shared, 123);
  EXPECT_EQ(alikeNote(*second, "n.json").find("n.json: '2' and '3' look alike (75 %"), 0U);
  // Another set is another question, also where all of its features are known.
  const auto fewer = readNaturalMarkers(file({"mixed.png", "a.png"}));
  ASSERT_TRUE(fewer) << fewer.error().message;
  EXPECT_EQ(fewer->computed, 0);
  ASSERT_EQ(fewer->alike.size(), 1U);
  EXPECT_NE(fewer->alike[0].shared, 123);
}

}  // namespace
}  // namespace waymark::io
