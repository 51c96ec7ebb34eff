// Which features of which pictures look like a given one: descriptors of many pictures in one
// index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/split_mix.h"
#include "slam/natural/pictures/picture_features.h"

namespace waymark::slam {

struct DescriptorIndexOptions {
  // Randomized kd-trees searched side by side, best bins first (Silpa-Anan and Hartley). More find
  // more of the true neighbours, and cost memory: 4 bytes a descriptor each.
  int trees = 4;
  // Descriptors compared with a query, at most. 128 find nine in ten of the nearest among 500 000.
  int comparisons = 160;
  int leaf_size = 8;
  // Up to so many descriptors are all compared: nothing is gained by trees.
  int exhaustive_up_to = 1500;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A copy of what it is made from. Deterministic: equal sets in equal order give equal answers.
class DescriptorIndex {
 public:
  struct Neighbour {
    int picture = -1;  // the place of its set among those given
    int feature = -1;  // within that set
    int distance = 0;  // descriptorDistance()
  };
  // What a query needs, reused from one to the next.
  struct Workspace {
    struct Branch {
      float bound = 0.0F;  // squared distance to the branch, from below
      int tree = 0;
      int node = 0;
    };
    std::vector<Branch> branches;        // a heap, the nearest first
    std::vector<std::uint32_t> visited;  // of each descriptor: the query that compared it last
    std::uint32_t query = 0;
  };

  DescriptorIndex() = default;
  // Null for a set to be left out. Those without descriptors, or of another kind or length than the
  // first with any, are left out, too.
  explicit DescriptorIndex(std::span<const FeatureSet* const> sets,
                           const DescriptorIndexOptions& options = {});

  [[nodiscard]] std::size_t size() const { return entries_.size(); }

  // The nearest `count`, nearest first; fewer when there are not so many. Descriptors of bits,
  // which trees of coordinates know nothing of, are all compared.
  void nearest(const std::uint8_t* descriptor, std::size_t count, Workspace* workspace,
               std::vector<Neighbour>* found) const;

 private:
  struct Entry {
    int picture;
    int feature;
  };
  // An inner node splits at `value` of coordinate `axis`: below on the left, the node after it. A
  // leaf (axis -1) has the entries order_[first .. first + count).
  struct Node {
    int axis = -1;
    float value = 0.0F;
    int right = -1;
    int first = 0;
    int count = 0;
  };
  struct Tree {
    std::vector<Node> nodes;
    std::vector<int> order;
  };

  [[nodiscard]] const std::uint8_t* descriptor(int entry) const {
    return descriptors_.data() + static_cast<std::size_t>(entry) * static_cast<std::size_t>(bytes_);
  }
  void build(Tree* tree, int first, int count, SplitMix64* random) const;
  [[nodiscard]] int splitAxis(std::span<const int> entries, SplitMix64* random, float* value) const;
  void compare(int entry, const std::uint8_t* query, std::size_t count,
               std::vector<Neighbour>* found) const;
  // Down to the leaf of the query; the branches not taken are kept for later. Returns how many
  // descriptors were compared.
  int descend(int tree, int node, float bound, const std::uint8_t* query, std::size_t count,
              Workspace* workspace, std::vector<Neighbour>* found) const;

  DescriptorIndexOptions options_;
  FeatureKind kind_ = FeatureKind::kSift;
  int bytes_ = 0;
  std::vector<Entry> entries_;
  std::vector<std::uint8_t> descriptors_;
  std::vector<Tree> trees_;
};

}  // namespace waymark::slam
