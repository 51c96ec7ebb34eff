// Files of natural markers and targets, as the rest of the project reads them.
#include "simulator/natural_files.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/pictures/natural_marker_set.h"
#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::simulator {
namespace {

namespace fs = std::filesystem;

Scene tableScene() {
  Options options;
  options.scene = "table";
  options.size = ImageSize{64, 48};
  return *buildScene(options, Ending::kOfTheScene);
}

TEST(NaturalFiles, AreWhatWasHung) {
  const Scene scene = tableScene();
  const waymark::testing::TemporaryDirectory directory;
  const Status status = writeNatural(directory.path(), scene);
  ASSERT_TRUE(status.ok()) << status.error().message;

  const auto set = io::parseNaturalMarkers(*io::readTextFile(directory / "natural.json"),
                                           directory / "natural.json");
  ASSERT_TRUE(set) << set.error().message;
  ASSERT_EQ(set->size(), 25U);
  for (std::size_t i = 0; i < set->size(); ++i) {
    const io::NaturalMarkerEntry& entry = (*set)[i];
    EXPECT_EQ(entry.name, scene.natural[i].name);
    EXPECT_EQ(entry.T_w_m.has_value(), i < 6) << entry.name;
    EXPECT_NEAR(entry.height_m, entry.width_m * 4.0 / 3.0, 1e-9);
    EXPECT_TRUE(fs::exists(directory / entry.image.string())) << entry.image;
    if (!entry.T_w_m) continue;
    EXPECT_TRUE(std::ranges::any_of(scene.prints, [&](const Print& print) {
      return (entry.T_w_m->p - print.T_w_p.p).norm() < 1e-9 &&
             slam::rotationDistance(entry.T_w_m->R, print.T_w_p.R) < 1e-6 &&
             print.width_m == entry.width_m && print.height_m == entry.height_m;
    })) << entry.name;
  }

  // One of them and those elsewhere; it can be used.
  const auto only_f = io::parseNaturalMarkers(*io::readTextFile(directory / "natural_F.json"),
                                              directory / "natural_F.json");
  ASSERT_TRUE(only_f) << only_f.error().message;
  ASSERT_EQ(only_f->size(), 20U);
  EXPECT_EQ(only_f->front().name, "F");
  EXPECT_TRUE(only_f->front().T_w_m.has_value());
  EXPECT_FALSE(only_f->back().T_w_m.has_value());
  const auto read = io::readNaturalMarker(directory / only_f->front().image.string(),
                                          only_f->front().width_m, only_f->front().height_m);
  EXPECT_TRUE(read.ok()) << read.error().message;

  const auto targets = nlohmann::json::parse(std::ifstream(directory / "gt_targets.json"));
  ASSERT_EQ(targets["targets"].size(), 11U);
  for (std::size_t i = 0; i < 11; ++i) {
    const auto& p = targets["targets"][i]["p"];
    const Eigen::Vector3d target(p[0].get<double>(), p[1].get<double>(), p[2].get<double>());
    EXPECT_LT((target - scene.targets[i].p_w).norm(), 1e-9);
  }

  removeNatural(directory.path(), scene);
  EXPECT_TRUE(fs::is_empty(directory.path()));
}

TEST(NaturalFiles, AreNotThereWhereASceneHasNone) {
  Options options;
  const waymark::testing::TemporaryDirectory directory;
  ASSERT_TRUE(writeNatural(directory.path(), *buildScene(options, Ending::kOfTheScene)).ok());
  EXPECT_TRUE(fs::is_empty(directory.path()));
}

}  // namespace
}  // namespace waymark::simulator
