// Pictures from a directory, and made up.
#include "simulator/album.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <string>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "simulator/scene.h"
#include "tests/temporary_directory.h"

namespace waymark::simulator {
namespace {

class AlbumTest : public ::testing::Test {
 protected:
  // Squares of `grey` and black, by which it can be recognized; below `textured_rows` all grey.
  void save(const std::string& name, int width, int height, int grey, int textured_rows) const {
    cv::Mat image(height, width, CV_8U, cv::Scalar::all(grey));
    for (int y = 20; y + 20 < textured_rows; y += 40) {
      for (int x = 20; x + 20 < width; x += 40) image(cv::Rect(x, y, 20, 20)).setTo(0);
    }
    ASSERT_TRUE(cv::imwrite((directory_ / name).string(), image));
  }

  const waymark::testing::TemporaryDirectory directory_;
};

TEST_F(AlbumTest, PostersAreMadeUpWithoutADirectory) {
  Album a = *Album::open({}, 1, 3);
  Album same = *Album::open({}, 1, 3);
  Album other = *Album::open({}, 2, 3);
  const PosterImage first = a.next();
  EXPECT_EQ(first.grey, same.next().grey);
  EXPECT_NE(first.grey, other.next().grey);
  EXPECT_NE(first.grey, a.next().grey);
}

TEST_F(AlbumTest, TakesEachFileOnceBeforeASecondPartOfOne) {
  save("a.png", 300, 400, 150, 400);
  save("b.png", 300, 400, 180, 400);
  save("c.PNG", 1400, 700, 210, 700);
  save("plain.png", 1400, 700, 240, 0);
  std::ofstream(directory_ / "notes.txt") << "no picture";
  Album album = *Album::open(directory_.path(), 5, 5);
  Album again = *Album::open(directory_.path(), 5, 5);
  std::multiset<int> greys;
  for (int i = 0; i < 5; ++i) {
    const PosterImage picture = album.next();
    EXPECT_EQ(picture.grey, again.next().grey);
    EXPECT_EQ(picture.grey.size(),
              static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height));
    greys.insert(*std::ranges::max_element(picture.grey));
    if (i < 3) continue;
    EXPECT_EQ(picture.width, 450);
    EXPECT_EQ(picture.height, 600);
  }
  EXPECT_EQ(greys, (std::multiset<int>{150, 180, 210, 210, 210}));
}

// Half of it is sky.
TEST_F(AlbumTest, LeavesOutPartsWithoutTexture) {
  save("a.png", 450, 1200, 150, 600);
  EXPECT_TRUE(Album::open(directory_.path(), 1, 1).ok());
  EXPECT_FALSE(Album::open(directory_.path(), 1, 2).ok());
}

TEST_F(AlbumTest, SaysWhatIsWrongInOneLine) {
  const auto reason = [](const std::filesystem::path& directory, int count) {
    const auto album = Album::open(directory, 1, count);
    return album ? std::string() : album.error().message;
  };
  EXPECT_EQ(reason("/nowhere/at/all", 3),
            "/nowhere/at/all: cannot read: No such file or directory");
  save("a.png", 300, 400, 150, 400);
  EXPECT_EQ(reason(directory_.path(), 2),
            directory_.path().string() +
                ": its jpg and png files give 1 pictures with texture, but the scene needs 2");
  EXPECT_EQ(reason(directory_.path(), 1), "");
  std::ofstream(directory_ / "a.png", std::ios::trunc) << "not a picture";
  EXPECT_EQ(reason(directory_.path(), 1),
            (directory_ / "a.png").string() + ": is no image that can be read");
}

TEST_F(AlbumTest, ASceneSaysThatItsPicturesAreTooFew) {
  save("a.png", 300, 400, 150, 400);
  Options options;
  options.scene = "office";
  options.pictures = directory_.path();
  const auto scene = buildScene(options, Ending::kOfTheScene);
  ASSERT_FALSE(scene.ok());
  EXPECT_NE(scene.error().message.find("give 1 pictures"), std::string::npos);
  options.scene = "walls";  // needs none
  EXPECT_TRUE(buildScene(options, Ending::kOfTheScene).ok());
}

}  // namespace
}  // namespace waymark::simulator
