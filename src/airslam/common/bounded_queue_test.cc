// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/bounded_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>
#include <vector>

namespace airslam {
namespace {

TEST(BoundedQueueTest, KeepsTheOrder) {
  BoundedQueue<int> queue(3);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(queue.Push(i));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(queue.Pop(), i);
}

TEST(BoundedQueueTest, MovesItems) {
  BoundedQueue<std::unique_ptr<int>> queue(1);
  EXPECT_TRUE(queue.Push(std::make_unique<int>(7)));
  EXPECT_EQ(**queue.Pop(), 7);
}

TEST(BoundedQueueTest, CloseLetsTheRestBePoppedThenEnds) {
  BoundedQueue<int> queue(2);
  queue.Push(1);
  queue.Push(2);
  queue.Close();
  EXPECT_FALSE(queue.Push(3));
  EXPECT_EQ(queue.Pop(), 1);
  EXPECT_EQ(queue.Pop(), 2);
  EXPECT_EQ(queue.Pop(), std::nullopt);
  EXPECT_EQ(queue.Pop(), std::nullopt);
}

TEST(BoundedQueueTest, CloseWakesWaitingConsumers) {
  BoundedQueue<int> queue(1);
  std::vector<std::thread> consumers;
  for (int i = 0; i < 3; ++i) {
    consumers.emplace_back([&] { EXPECT_EQ(queue.Pop(), std::nullopt); });
  }
  queue.Close();
  for (std::thread& consumer : consumers) consumer.join();
}

TEST(BoundedQueueTest, CloseWakesWaitingProducers) {
  BoundedQueue<int> queue(1);
  queue.Push(0);
  std::vector<std::thread> producers;
  for (int i = 0; i < 3; ++i) producers.emplace_back([&] { EXPECT_FALSE(queue.Push(1)); });
  queue.Close();
  for (std::thread& producer : producers) producer.join();
  EXPECT_EQ(queue.Pop(), 0);
  EXPECT_EQ(queue.Pop(), std::nullopt);
}

// The producer may run ahead of the consumer by the capacity and the one item it is pushing.
TEST(BoundedQueueTest, NeverHoldsMoreThanItsCapacity) {
  constexpr int kCapacity = 4;
  BoundedQueue<int> queue(kCapacity);
  std::atomic<int> pushed = 0;
  std::thread producer([&] {
    for (int i = 0; i < 1000; ++i) {
      queue.Push(i);
      ++pushed;
    }
    queue.Close();
  });
  int popped = 0;
  while (queue.Pop()) {
    ++popped;
    EXPECT_LE(pushed.load(), popped + kCapacity);
  }
  producer.join();
  EXPECT_EQ(popped, 1000);
}

TEST(BoundedQueueTest, ManyProducersAndConsumersLoseNothing) {
  constexpr int kThreads = 4;
  constexpr int kItems = 2000;
  BoundedQueue<int> queue(5);
  std::vector<std::thread> producers;
  for (int p = 0; p < kThreads; ++p) {
    producers.emplace_back([&queue, p] {
      for (int i = 0; i < kItems; ++i) queue.Push(p * kItems + i);
    });
  }
  std::vector<std::vector<int>> received(kThreads);
  std::vector<std::thread> consumers;
  for (int c = 0; c < kThreads; ++c) {
    consumers.emplace_back([&queue, &mine = received[c]] {
      while (const auto item = queue.Pop()) mine.push_back(*item);
    });
  }
  for (std::thread& producer : producers) producer.join();
  queue.Close();
  for (std::thread& consumer : consumers) consumer.join();

  std::vector<int> all;
  for (const std::vector<int>& mine : received) {
    // One producer's items reach any one consumer in their order.
    for (int p = 0; p < kThreads; ++p) {
      int last = -1;
      for (const int item : mine) {
        if (item / kItems != p) continue;
        EXPECT_GT(item, last);
        last = item;
      }
    }
    all.insert(all.end(), mine.begin(), mine.end());
  }
  std::sort(all.begin(), all.end());
  ASSERT_EQ(all.size(), static_cast<std::size_t>(kThreads * kItems));
  for (int i = 0; i < kThreads * kItems; ++i) ASSERT_EQ(all[i], i);
}

}  // namespace
}  // namespace airslam
