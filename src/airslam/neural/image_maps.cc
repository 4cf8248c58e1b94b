// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/image_maps.h"

#include <algorithm>
#include <mutex>
#include <utility>

namespace airslam {

struct ImageMapPool::Shelf {
  std::mutex mutex;
  std::vector<std::unique_ptr<ImageMaps>> free;
};

ImageMapPool::ImageMapPool() : shelf_(std::make_shared<Shelf>()) {}

std::shared_ptr<ImageMaps> ImageMapPool::Take(cv::Size image_size, std::span<const int> sizes) {
  std::unique_ptr<ImageMaps> maps;
  {
    const std::scoped_lock lock(shelf_->mutex);
    const auto fits = [&](const auto& known) { return known->image_size == image_size; };
    const auto found = std::find_if(shelf_->free.begin(), shelf_->free.end(), fits);
    if (found != shelf_->free.end()) {
      maps = std::move(*found);
      shelf_->free.erase(found);
    } else {
      shelf_->free.clear();  // of another size: the images have changed
    }
  }
  if (!maps) maps = std::make_unique<ImageMaps>(ImageMaps{image_size, {}});
  maps->values.resize(sizes.size());
  for (std::size_t i = 0; i < sizes.size(); ++i) maps->values[i].create(1, sizes[i], CV_32FC1);
  return {maps.release(), [shelf = shelf_](ImageMaps* done) {
            const std::scoped_lock lock(shelf->mutex);
            shelf->free.emplace_back(done);
          }};
}

}  // namespace airslam
