#include "io/text/closest_word.h"

#include <vector>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

const std::vector<std::string> kCommands = {"run", "record", "eval", "echo", "calibrate", "print"};

TEST(ClosestWord, CountsWhatIsToBeChanged) {
  EXPECT_EQ(editDistance("", ""), 0);
  EXPECT_EQ(editDistance("abc", ""), 3);
  EXPECT_EQ(editDistance("", "abc"), 3);
  EXPECT_EQ(editDistance("kitten", "sitting"), 3);
  EXPECT_EQ(editDistance("RUN", "run"), 0) << "case does not count";
  EXPECT_EQ(editDistance("pritn", "print"), 1) << "two letters in the wrong order";
  EXPECT_EQ(editDistance("ab", "ba"), editDistance("ba", "ab"));
}

TEST(ClosestWord, FindsTheNearest) {
  EXPECT_EQ(closestWord("calibrat", kCommands), "calibrate");
  EXPECT_EQ(closestWord("ehco", kCommands), "echo");
  EXPECT_EQ(closestWord("Record", kCommands), "record");
  EXPECT_EQ(closestWord("runn", kCommands), "run");
}

TEST(ClosestWord, NothingNearIsNothing) {
  EXPECT_EQ(closestWord("fly", kCommands), std::nullopt);
  EXPECT_EQ(closestWord("rum", kCommands), std::nullopt) << "too short to tell";
  EXPECT_EQ(closestWord("", kCommands), std::nullopt);
  EXPECT_EQ(closestWord("photosynthesis", kCommands), std::nullopt);
  EXPECT_EQ(closestWord("run", {}), std::nullopt);
  EXPECT_EQ(closestWord(std::string(100'000, 'r'), kCommands), std::nullopt);
}

TEST(ClosestWord, AsPartOfAMessage) {
  EXPECT_EQ(didYouMean("prnt", kCommands), "; did you mean print?");
  EXPECT_EQ(didYouMean("fly", kCommands), "");
}

}  // namespace
}  // namespace waymark::io
