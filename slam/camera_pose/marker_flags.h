// One flag for each marker of a frame. As many as a frame ever shows need no memory of their own.
#pragma once

#include <bitset>
#include <cstddef>
#include <initializer_list>
#include <vector>

namespace waymark::slam {

class MarkerFlags {
 public:
  MarkerFlags() = default;
  MarkerFlags(std::initializer_list<bool> flags) {
    assign(flags.size(), false);
    std::size_t i = 0;
    for (const bool flag : flags) set(i++, flag);
  }

  void assign(std::size_t count, bool flag) {
    size_ = count;
    flag ? first_.set() : first_.reset();
    rest_.assign(count > kFirst ? count - kFirst : 0, flag);
  }
  [[nodiscard]] bool operator[](std::size_t i) const {
    return i < kFirst ? first_[i] : rest_[i - kFirst];
  }
  void set(std::size_t i, bool flag) {
    if (i < kFirst) {
      first_[i] = flag;
    } else {
      rest_[i - kFirst] = flag;
    }
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t count() const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < size_; ++i) count += (*this)[i] ? 1 : 0;
    return count;
  }

 private:
  static constexpr std::size_t kFirst = 256;
  std::size_t size_ = 0;
  std::bitset<kFirst> first_;
  std::vector<bool> rest_;
};

}  // namespace waymark::slam
