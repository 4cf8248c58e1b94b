// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/openvino_network.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif
#include <unistd.h>

#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <openvino/openvino.hpp>
#include <string>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

ov::Core& Core() {
#if defined(__SANITIZE_ADDRESS__)
  // Else the TBB that OpenVINO brings loads a library in a way that AddressSanitizer refuses.
  setenv("TBB_ENABLE_SANITIZERS", "1", 0);
#endif
  static ov::Core core;
  return core;
}

TensorShape FromPartialShape(const ov::PartialShape& shape, const std::string& file,
                             const std::string& name) {
  if (shape.rank().is_dynamic()) {
    Fail("{}: '{}' has an unknown number of dimensions", file, name);
  }
  TensorShape result;
  for (const ov::Dimension& d : shape) result.push_back(d.is_static() ? d.get_length() : -1);
  return result;
}

template <typename Node>
TensorPort ToPort(const ov::Output<Node>& output, const std::string& file) {
  const std::string name = output.get_names().empty() ? std::string() : output.get_any_name();
  if (output.get_element_type() != ov::element::f32) {
    Fail("{}: '{}' holds {}, expected f32", file, name, output.get_element_type().get_type_name());
  }
  return {name, FromPartialShape(output.get_partial_shape(), file, name)};
}

class OpenVinoNetwork final : public Network {
 public:
  OpenVinoNetwork(std::string file, ov::CompiledModel model)
      : file_(std::move(file)), model_(std::move(model)), request_(model_.create_infer_request()) {
    for (const auto& input : model_.inputs()) inputs_.push_back(ToPort(input, file_));
    for (const auto& output : model_.outputs()) outputs_.push_back(ToPort(output, file_));
  }

  const std::vector<TensorPort>& inputs() const override { return inputs_; }
  const std::vector<TensorPort>& outputs() const override { return outputs_; }
  std::string description() const override { return file_; }

  TensorView Output(std::string_view name) const override {
    const auto index = static_cast<std::size_t>(&OutputPort(name) - outputs_.data());
    const ov::Tensor tensor = request_.get_output_tensor(index);
    const ov::Shape& shape = tensor.get_shape();
    return {tensor.data<float>(), TensorShape(shape.begin(), shape.end())};
  }

 private:
  void RunChecked(std::span<const TensorView* const> inputs,
                  std::span<float* const> outputs) override {
    try {
      for (std::size_t i = 0; i < inputs.size(); ++i) {
        // OpenVINO wants a mutable pointer but only reads an input.
        float* data = const_cast<float*>(inputs[i]->data);
        const ov::Shape shape(inputs[i]->shape.begin(), inputs[i]->shape.end());
        request_.set_input_tensor(i, ov::Tensor(ov::element::f32, shape, data));
      }
      for (std::size_t i = 0; i < outputs.size(); ++i) {
        if (outputs[i] == nullptr) continue;
        const ov::Shape& shape = model_.output(i).get_shape();
        request_.set_output_tensor(i, ov::Tensor(ov::element::f32, shape, outputs[i]));
      }
      request_.infer();
    } catch (const ov::Exception& error) {
      Fail("{}: OpenVINO could not run the network: {}", file_, error.what());
    }
  }

  std::string file_;
  ov::CompiledModel model_;
  mutable ov::InferRequest request_;  // get_output_tensor() is not const
  std::vector<TensorPort> inputs_;
  std::vector<TensorPort> outputs_;
};

// Creates `folder` and tells whether files can be made in it.
bool IsWritableFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  return std::filesystem::is_directory(folder, error) && access(folder.c_str(), W_OK | X_OK) == 0;
}

// With a cache OpenVINO sets the process's locale to "C" while it compiles, and back: on two
// threads at once it stayed so, and a Python program could then write no letter beyond ASCII. So it
// is "C" from the first of such threads to the last, and OpenVINO finds nothing to change.
class PlainLocale {
 public:
  PlainLocale() {
    const std::scoped_lock lock(mutex_);
    if (users_++ > 0) return;
    before_ = std::setlocale(LC_ALL, nullptr);
    std::setlocale(LC_ALL, "C");
  }
  ~PlainLocale() {
    const std::scoped_lock lock(mutex_);
    if (--users_ == 0) std::setlocale(LC_ALL, before_.c_str());
  }
  PlainLocale(const PlainLocale&) = delete;
  PlainLocale& operator=(const PlainLocale&) = delete;

 private:
  static inline std::mutex mutex_;
  static inline int users_ = 0;
  static inline std::string before_;
};

ov::CompiledModel Compile(const std::shared_ptr<ov::Model>& model, const ov::AnyMap& config) {
  const PlainLocale locale;
  return Core().compile_model(model, "CPU", config);
}

std::shared_ptr<ov::Model> ReadModel(const std::string& file) {
  if (!std::filesystem::is_regular_file(file)) Fail("{}: no such network file", file);
  const std::string ending = std::filesystem::path(file).extension().string();
  if (ending != ".onnx" && ending != ".xml") {  // OpenVINO would try every format that it knows
    Fail("{}: not a network: expected a file that ends in .onnx or .xml", file);
  }
  try {
    return Core().read_model(file);
  } catch (const std::exception& error) {
    Fail("{}: not a network that OpenVINO can read: {}", file, error.what());
  }
}

void Reshape(ov::Model& model, const std::map<std::string, TensorShape>& input_shapes,
             const std::string& file) {
  std::map<std::string, ov::PartialShape> shapes;
  std::vector<TensorPort> ports;
  for (const auto& input : std::as_const(model).inputs()) ports.push_back(ToPort(input, file));
  for (const auto& [name, shape] : input_shapes) {
    bool found = false;
    for (const TensorPort& port : ports) found = found || port.name == name;
    if (!found) Fail("{}: the network has no input '{}' to reshape", file, name);
    shapes[name] = ov::PartialShape(std::vector<ov::Dimension>(shape.begin(), shape.end()));
  }
  if (shapes.empty()) return;
  try {
    model.reshape(shapes);
  } catch (const std::exception& error) {
    std::string wanted;
    for (const auto& [name, shape] : input_shapes) {
      wanted += fmt::format("{}'{}' {}", wanted.empty() ? "" : ", ", name, ToString(shape));
    }
    Fail("{}: the network does not accept the input shapes {}: {}", file, wanted, error.what());
  }
}

}  // namespace

void OpenVinoOptions::Validate() const {
  if (threads < 1) Fail("OpenVinoOptions.threads is {}, expected at least 1", threads);
}

std::string OpenVinoVersion() {
  const std::string build = ov::get_openvino_version().buildNumber;
  return build.substr(0, build.find('-'));
}

bool IsFasterInBf16() {
#if defined(__x86_64__)
  // AMX-BF16: bit 22 of EDX of leaf 7. clang 14 does not know its name, with which g++ would ask.
  unsigned eax = 0, ebx = 0, ecx = 0, edx = 0;
  const bool amx = __get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) != 0 && (edx >> 22 & 1) != 0;
  return amx || (__builtin_cpu_supports("avx512bf16") && !__builtin_cpu_is("intel"));
#else
  return false;
#endif
}

std::string DefaultCacheFolder() {
  const char* xdg = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  std::filesystem::path folder;
  if (xdg != nullptr && *xdg == '/') {
    folder = std::filesystem::path(xdg) / "airslam";
  } else if (home != nullptr && *home == '/') {
    folder = std::filesystem::path(home) / ".cache" / "airslam";
  } else {
    return "";
  }
  return IsWritableFolder(folder) ? folder.string() : "";
}

std::unique_ptr<Network> LoadOpenVinoNetwork(const std::string& file,
                                             const std::map<std::string, TensorShape>& input_shapes,
                                             const OpenVinoOptions& options) {
  options.Validate();
  const std::shared_ptr<ov::Model> model = ReadModel(file);
  Reshape(*model, input_shapes, file);
  const bool bf16 = options.precision == Precision::kBf16 ||
                    (options.precision == Precision::kAuto && IsFasterInBf16());
  ov::AnyMap config = {
      ov::hint::inference_precision(bf16 ? ov::element::bf16 : ov::element::f32),
      ov::hint::performance_mode(ov::hint::PerformanceMode::LATENCY),
      ov::inference_num_threads(options.threads),
      ov::num_streams(1),
      ov::hint::enable_cpu_pinning(false),
  };
  std::string cache = options.cache_folder == "auto" ? DefaultCacheFolder() : options.cache_folder;
  if (!cache.empty() && !IsWritableFolder(cache)) cache.clear();
  if (!cache.empty()) {
    ov::AnyMap cached = config;
    cached.insert(ov::cache_dir(cache));
    try {
      return std::make_unique<OpenVinoNetwork>(file, Compile(model, cached));
    } catch (const ov::Exception&) {  // a cache that fails, say on a full disk, is done without
    }
  }
  try {
    return std::make_unique<OpenVinoNetwork>(file, Compile(model, config));
  } catch (const ov::Exception& error) {
    Fail("{}: OpenVINO could not compile the network: {}", file, error.what());
  }
}

NetworkLoader OpenVinoLoader(const OpenVinoOptions& options) {
  options.Validate();
  return
      [options](const std::string& file, const std::map<std::string, TensorShape>& input_shapes) {
        return LoadOpenVinoNetwork(file, input_shapes, options);
      };
}

}  // namespace airslam
