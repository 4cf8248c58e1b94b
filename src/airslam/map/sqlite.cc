// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/sqlite.h"

#include <sqlite3.h>

#include <bit>

namespace airslam {
namespace {

// FNV-1a, 64 bits (Fowler, Noll, Vo; IETF draft-eastlake-fnv).
class Fnv {
 public:
  void Update(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) hash_ = (hash_ ^ bytes[i]) * 0x100000001b3u;
  }
  template <class T>
  void Add(char type, const T& value) {
    Update(&type, 1);
    Update(&value, sizeof(value));
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325u;
};

void AddValue(Fnv& hash, sqlite3_value* value) {
  switch (sqlite3_value_type(value)) {
    case SQLITE_INTEGER:
      return hash.Add('i', std::int64_t{sqlite3_value_int64(value)});
    case SQLITE_FLOAT:
      return hash.Add('r', sqlite3_value_double(value) + 0.0);
    case SQLITE_NULL:
      return hash.Update("n", 1);
    default: {
      const bool is_text = sqlite3_value_type(value) == SQLITE_TEXT;
      const void* data =
          is_text ? static_cast<const void*>(sqlite3_value_text(value)) : sqlite3_value_blob(value);
      const auto size = static_cast<std::uint64_t>(sqlite3_value_bytes(value));
      hash.Add(is_text ? 't' : 'b', size);
      if (data != nullptr) hash.Update(data, size);
    }
  }
}

extern "C" void RowChecksum(sqlite3_context* context, int count, sqlite3_value** values) {
  Fnv hash;
  for (int i = 0; i < count; ++i) AddValue(hash, values[i]);
  sqlite3_result_int64(context, std::bit_cast<std::int64_t>(hash.value()));
}

[[noreturn]] void Throw(sqlite3* handle, int result_code) {
  throw SqliteError(result_code & 0xff,
                    handle != nullptr ? sqlite3_errmsg(handle) : sqlite3_errstr(result_code));
}

}  // namespace

SqliteDatabase::SqliteDatabase(const std::filesystem::path& file, Mode mode) {
  const int flags = mode == Mode::kCreate
                        ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX
                        : SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX;
  const int result = sqlite3_open_v2(file.c_str(), &handle_, flags, nullptr);
  if (result != SQLITE_OK) {
    const std::string text = handle_ != nullptr ? sqlite3_errmsg(handle_) : "out of memory";
    sqlite3_close_v2(handle_);
    throw SqliteError(result & 0xff, text);
  }
  sqlite3_busy_timeout(handle_, 10'000);
  sqlite3_create_function_v2(handle_, "row_checksum", -1, SQLITE_UTF8 | SQLITE_DETERMINISTIC,
                             nullptr, RowChecksum, nullptr, nullptr, nullptr);
}

SqliteDatabase::~SqliteDatabase() { sqlite3_close_v2(handle_); }

void SqliteDatabase::Execute(const std::string& sql) {
  const int result = sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
  if (result != SQLITE_OK) Throw(handle_, result);
}

std::int64_t SqliteDatabase::QueryInteger(const std::string& sql) {
  SqliteStatement statement(*this, sql);
  return statement.Step() ? statement.Integer(0) : 0;
}

std::string SqliteDatabase::QueryText(const std::string& sql) {
  SqliteStatement statement(*this, sql);
  return statement.Step() ? statement.Text(0) : "";
}

int SqliteDatabase::Changes() const { return sqlite3_changes(handle_); }

void SqliteStatement::Finalizer::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

SqliteStatement::SqliteStatement(SqliteDatabase& database, const std::string& sql)
    : database_(database) {
  sqlite3_stmt* statement = nullptr;
  const int result = sqlite3_prepare_v2(database.handle(), sql.c_str(),
                                        static_cast<int>(sql.size()), &statement, nullptr);
  statement_.reset(statement);
  Check(result);
}

void SqliteStatement::Check(int result_code) const {
  if (result_code != SQLITE_OK) Throw(database_.handle(), result_code);
}

void SqliteStatement::Bind(int parameter, std::int64_t value) {
  Check(sqlite3_bind_int64(statement_.get(), parameter, value));
}

void SqliteStatement::Bind(int parameter, double value) {
  Check(sqlite3_bind_double(statement_.get(), parameter, value));
}

void SqliteStatement::Bind(int parameter, std::string_view text) {
  Check(sqlite3_bind_text(statement_.get(), parameter, text.data(), static_cast<int>(text.size()),
                          SQLITE_STATIC));
}

void SqliteStatement::Bind(int parameter, std::span<const std::byte> blob) {
  // A null pointer would bind NULL: an empty blob needs another address.
  const void* data = blob.empty() ? "" : static_cast<const void*>(blob.data());
  Check(sqlite3_bind_blob64(statement_.get(), parameter, data, blob.size_bytes(), SQLITE_STATIC));
}

void SqliteStatement::BindNull(int parameter) {
  Check(sqlite3_bind_null(statement_.get(), parameter));
}

bool SqliteStatement::Step() {
  const int result = sqlite3_step(statement_.get());
  if (result == SQLITE_ROW) return true;
  if (result == SQLITE_DONE) return false;
  Throw(database_.handle(), result);
}

void SqliteStatement::Run() {
  try {
    while (Step()) {
    }
  } catch (const SqliteError&) {
    Reset();
    throw;
  }
  Reset();
}

void SqliteStatement::Reset() {
  sqlite3_reset(statement_.get());
  sqlite3_clear_bindings(statement_.get());
}

std::int64_t SqliteStatement::Integer(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

double SqliteStatement::Real(int column) const {
  return sqlite3_column_double(statement_.get(), column);
}

std::string SqliteStatement::Text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
  if (text == nullptr) return "";
  return {text, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

std::span<const std::byte> SqliteStatement::Blob(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  if (data == nullptr) return {};
  return {static_cast<const std::byte*>(data),
          static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

bool SqliteStatement::IsNull(int column) const { return Type(column) == SQLITE_NULL; }

int SqliteStatement::columns() const { return sqlite3_column_count(statement_.get()); }

int SqliteStatement::Type(int column) const {
  return sqlite3_column_type(statement_.get(), column);
}

SqliteTransaction::SqliteTransaction(SqliteDatabase& database) : database_(database) {
  database_.Execute("BEGIN IMMEDIATE");
}

SqliteTransaction::~SqliteTransaction() {
  if (open_) sqlite3_exec(database_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

void SqliteTransaction::Commit() {
  database_.Execute("COMMIT");
  open_ = false;
}

}  // namespace airslam
