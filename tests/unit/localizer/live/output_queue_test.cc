// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/output_queue.h"

#include <gtest/gtest.h>

namespace shiftmap::live {
namespace {

std::string Drain(OutputQueue* queue) {
  std::string all;
  while (!queue->empty()) {
    all += queue->Front();
    queue->Sent(queue->Front().size());
  }
  return all;
}

TEST(OutputQueueTest, SlowReaderLosesTheOldestNews) {
  OutputQueue queue(10);
  for (const char* is_event : {"aaa", "bbb", "ccc", "ddd"}) queue.PushEvent(is_event);
  EXPECT_EQ(queue.dropped(), 1);
  EXPECT_LE(queue.bytes(), 10u);
  EXPECT_EQ(Drain(&queue), "bbbcccddd");
  EXPECT_EQ(queue.bytes(), 0u);
}

TEST(OutputQueueTest, WhatHasBegunIsFinished) {
  OutputQueue queue(6);
  queue.PushEvent("aaa");
  queue.Sent(1);
  queue.PushEvent("bbb");
  queue.PushEvent("ccc");
  EXPECT_EQ(queue.dropped(), 1);
  EXPECT_EQ(Drain(&queue), "aaccc");
}

TEST(OutputQueueTest, RepliesPushNewsOutButNotEachOther) {
  OutputQueue queue(6);
  queue.PushEvent("nnn");
  EXPECT_TRUE(queue.PushReply("rrr"));
  EXPECT_TRUE(queue.PushReply("sss"));
  EXPECT_FALSE(queue.PushReply("ttt"));
  queue.PushEvent("mmm");
  EXPECT_EQ(queue.dropped(), 2);
  EXPECT_EQ(Drain(&queue), "rrrsss");
}

TEST(OutputQueueTest, NeverAboveItsBound) {
  OutputQueue queue(100);
  for (int i = 0; i < 10000; ++i) {
    queue.PushEvent(std::string(static_cast<std::size_t>(i % 130), 'x'));
    if (i % 7 == 0 && !queue.empty()) queue.Sent(queue.Front().size() / 2);
    ASSERT_LE(queue.bytes(), 100u);
  }
  EXPECT_GT(queue.dropped(), 9000);
}

}  // namespace
}  // namespace shiftmap::live
