#include "devices/loop/prefetcher.h"

#include <gtest/gtest.h>
#include <stdexcept>

namespace haptrace {
namespace {

struct Block {
  std::size_t index;
  std::vector<std::size_t> data;
};

std::unique_ptr<const Block> make_block(std::size_t index) {
  return std::make_unique<const Block>(Block{index, std::vector<std::size_t>(1000, index)});
}

TEST(Prefetcher, ReturnsTheRequestedBlockAndKeepsItWhileTheNextIsLoaded) {
  constexpr std::size_t kBlocks = 12;
  for (const std::size_t ahead : {1U, 2U, 5U, 20U}) {
    Prefetcher<Block> prefetcher(make_block(0), kBlocks, ahead, make_block);
    const Block* used = prefetcher.get(0);
    for (std::size_t repetition = 0; repetition < 100; ++repetition)
      for (std::size_t i = 0; i < kBlocks; ++i) {
        if ((repetition + i) % 3 != 0) prefetcher.wait(i);
        const Block* block = prefetcher.get(i);
        for (int asked = 0; block == nullptr; block = prefetcher.get(i)) {
          ASSERT_EQ(used->data.front(), used->index) << "freed while it was in use";
          if (++asked > 100) prefetcher.wait(i);
        }
        used = block;
        ASSERT_EQ(used->index, i);
        ASSERT_EQ(used->data.back(), i);
        if (i == 7 && repetition % 5 == 0) break;  // restart from the first block
      }
  }
}

TEST(Prefetcher, ReturnsTheBlocksBeforeOneThatCannotBeLoadedAndTheReason) {
  Prefetcher<Block> prefetcher(make_block(0), 12, 2, [](std::size_t index) {
    if (index == 4) throw std::runtime_error("block 4 is damaged");
    return make_block(index);
  });
  for (std::size_t i = 0; i < 4; ++i) {
    prefetcher.wait(i);
    ASSERT_NE(prefetcher.get(i), nullptr);
    ASSERT_FALSE(prefetcher.failed(i));
  }
  prefetcher.wait(4);
  EXPECT_EQ(prefetcher.get(4), nullptr);
  EXPECT_TRUE(prefetcher.failed(4));
  EXPECT_EQ(prefetcher.error(), "block 4 is damaged");
  EXPECT_NE(prefetcher.get(0), nullptr) << "the first stays";
}

}  // namespace
}  // namespace haptrace
