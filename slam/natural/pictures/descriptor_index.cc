#include "slam/natural/pictures/descriptor_index.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

bool farther(const DescriptorIndex::Workspace::Branch& a,
             const DescriptorIndex::Workspace::Branch& b) {
  if (a.bound != b.bound) return a.bound > b.bound;
  if (a.tree != b.tree) return a.tree > b.tree;
  return a.node > b.node;
}

}  // namespace

std::string DescriptorIndexOptions::invalidReason() const {
  return firstUnmet({
      {trees >= 1 && trees <= 32, "an index has 1 to 32 trees"},
      {comparisons >= 1, "an index needs at least 1 comparison a query"},
      {leaf_size >= 1, "a leaf has at least 1 descriptor"},
      {exhaustive_up_to >= 0, "the number of descriptors all compared must not be negative"},
  });
}

DescriptorIndex::DescriptorIndex(std::span<const FeatureSet* const> sets,
                                 const DescriptorIndexOptions& options)
    : options_(options) {
  for (std::size_t p = 0; p < sets.size(); ++p) {
    if (sets[p] == nullptr || sets[p]->size() == 0 || sets[p]->descriptor_bytes <= 0) continue;
    if (entries_.empty()) {
      kind_ = sets[p]->kind;
      bytes_ = sets[p]->descriptor_bytes;
    }
    if (sets[p]->kind != kind_ || sets[p]->descriptor_bytes != bytes_) continue;
    for (std::size_t f = 0; f < sets[p]->size(); ++f) {
      entries_.push_back({static_cast<int>(p), static_cast<int>(f)});
    }
    descriptors_.insert(descriptors_.end(), sets[p]->descriptors.begin(),
                        sets[p]->descriptors.end());
  }
  const int count = static_cast<int>(entries_.size());
  if (kind_ != FeatureKind::kSift || count <= options_.exhaustive_up_to) return;
  SplitMix64 random(0x6b64);  // any; it only has to be the same always
  trees_.resize(static_cast<std::size_t>(options_.trees));
  for (Tree& tree : trees_) {
    tree.order.resize(entries_.size());
    std::iota(tree.order.begin(), tree.order.end(), 0);
    build(&tree, 0, count, &random);
  }
}

// One of the coordinates that vary most, at their mean over some of the entries.
int DescriptorIndex::splitAxis(std::span<const int> entries, SplitMix64* random,
                               float* value) const {
  constexpr std::size_t kLooked = 64;  // entries that say how much a coordinate varies
  constexpr std::size_t kChoice = 5;   // the most varied, one of which is taken
  constexpr std::size_t kMost = 128;   // bytes of a SIFT descriptor
  const auto axes = std::min(kMost, static_cast<std::size_t>(bytes_));
  std::array<std::int64_t, kMost> sum{};
  std::array<std::int64_t, kMost> squares{};
  const std::size_t step = std::max<std::size_t>(1, entries.size() / kLooked);
  std::int64_t count = 0;
  for (std::size_t i = 0; i < entries.size(); i += step, ++count) {
    const std::uint8_t* d = descriptor(entries[i]);
    for (std::size_t k = 0; k < axes; ++k) {
      sum[k] += d[k];
      squares[k] += static_cast<std::int64_t>(d[k]) * d[k];
    }
  }
  std::array<std::size_t, kMost> order{};
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto spread = [&](std::size_t k) { return count * squares[k] - sum[k] * sum[k]; };
  const std::size_t choice = std::min(kChoice, axes);
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(choice),
                    order.begin() + static_cast<std::ptrdiff_t>(axes),
                    [&](std::size_t a, std::size_t b) {
                      return spread(a) != spread(b) ? spread(a) > spread(b) : a < b;
                    });
  const std::size_t axis = order[random->next() % choice];
  *value = static_cast<float>(sum[axis]) / static_cast<float>(count);
  return static_cast<int>(axis);
}

void DescriptorIndex::build(Tree* tree, int first, int count, SplitMix64* random) const {
  const std::size_t here = tree->nodes.size();
  tree->nodes.push_back({.first = first, .count = count});
  if (count <= options_.leaf_size) return;
  const auto begin = tree->order.begin() + first;
  float value = 0.0F;
  const int axis = splitAxis({&*begin, static_cast<std::size_t>(count)}, random, &value);
  const auto middle = std::partition(begin, begin + count, [&](int entry) {
    return static_cast<float>(descriptor(entry)[axis]) < value;
  });
  int left = static_cast<int>(middle - begin);
  // Equal descriptors (a print that is there twice) do not split by value.
  if (left == 0 || left == count) left = count / 2;
  tree->nodes[here].axis = axis;
  tree->nodes[here].value = value;
  build(tree, first, left, random);
  tree->nodes[here].right = static_cast<int>(tree->nodes.size());
  build(tree, first + left, count - left, random);
}

void DescriptorIndex::compare(int entry, const std::uint8_t* query, std::size_t count,
                              std::vector<Neighbour>* found) const {
  const int distance = descriptorDistance(kind_, query, descriptor(entry), bytes_);
  if (found->size() == count && distance >= found->back().distance) return;
  const Entry& e = entries_[static_cast<std::size_t>(entry)];
  const auto place = std::upper_bound(
      found->begin(), found->end(), distance,
      [](int value, const Neighbour& neighbour) { return value < neighbour.distance; });
  found->insert(place, {e.picture, e.feature, distance});
  if (found->size() > count) found->pop_back();
}

int DescriptorIndex::descend(int tree_index, int node, float bound, const std::uint8_t* query,
                             std::size_t count, Workspace* workspace,
                             std::vector<Neighbour>* found) const {
  const Tree& tree = trees_[static_cast<std::size_t>(tree_index)];
  while (true) {
    const Node& n = tree.nodes[static_cast<std::size_t>(node)];
    if (n.axis < 0) {
      int compared = 0;
      for (int i = n.first; i < n.first + n.count; ++i) {
        const int entry = tree.order[static_cast<std::size_t>(i)];
        std::uint32_t& visited = workspace->visited[static_cast<std::size_t>(entry)];
        if (visited == workspace->query) continue;
        visited = workspace->query;
        compare(entry, query, count, found);
        ++compared;
      }
      return compared;
    }
    const float beyond = static_cast<float>(query[n.axis]) - n.value;
    const bool left = beyond < 0.0F;
    workspace->branches.push_back({bound + beyond * beyond, tree_index, left ? n.right : node + 1});
    std::push_heap(workspace->branches.begin(), workspace->branches.end(), farther);
    node = left ? node + 1 : n.right;
  }
}

void DescriptorIndex::nearest(const std::uint8_t* query, std::size_t count, Workspace* workspace,
                              std::vector<Neighbour>* found) const {
  found->clear();
  if (count == 0) return;
  if (trees_.empty()) {
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      compare(static_cast<int>(i), query, count, found);
    }
    return;
  }
  if (workspace->visited.size() != entries_.size() || workspace->query == ~std::uint32_t{0}) {
    workspace->visited.assign(entries_.size(), 0);
    workspace->query = 0;
  }
  ++workspace->query;
  workspace->branches.clear();
  int compared = 0;
  for (int tree = 0; tree < static_cast<int>(trees_.size()); ++tree) {
    compared += descend(tree, 0, 0.0F, query, count, workspace, found);
  }
  while (compared < options_.comparisons && !workspace->branches.empty()) {
    std::pop_heap(workspace->branches.begin(), workspace->branches.end(), farther);
    const Workspace::Branch branch = workspace->branches.back();
    workspace->branches.pop_back();
    if (found->size() == count && branch.bound >= static_cast<float>(found->back().distance)) {
      break;  // no other branch is nearer
    }
    compared += descend(branch.tree, branch.node, branch.bound, query, count, workspace, found);
  }
}

}  // namespace waymark::slam
