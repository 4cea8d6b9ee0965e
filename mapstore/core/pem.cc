// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/pem.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <algorithm>
#include <ctime>

#include "mapstore/core/input_file.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxPemBytes = std::size_t{4} << 20;

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free(bio); }
};
using Bio = std::unique_ptr<BIO, FreeBio>;

Bio BioOf(const std::string& text) {
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

std::optional<Stamp> StampOf(const ASN1_TIME* time) {
  std::tm broken_down = {};
  if (ASN1_TIME_to_tm(time, &broken_down) != 1) return std::nullopt;
  const std::time_t seconds = timegm(&broken_down);
  // Certificates that shall never expire end in the year 9999, which is no stamp.
  constexpr std::time_t kLastSecond = 9'000'000'000;
  return Stamp(std::chrono::seconds(std::min(seconds, kLastSecond)));
}

// All that `read` finds of one kind, until something does not read.
template <typename T>
std::vector<std::shared_ptr<T>> AllOfPem(const std::string& pem,
                                         T* (*read)(BIO*, T**, pem_password_cb*, void*),
                                         void (*release)(T*)) {
  std::vector<std::shared_ptr<T>> found;
  const ForgottenErrors forgotten;
  const Bio bio = BioOf(pem);
  while (T* const next = read(bio.get(), nullptr, nullptr, nullptr)) {
    found.emplace_back(next, release);
  }
  return found;
}

}  // namespace

ForgottenErrors::~ForgottenErrors() { ERR_clear_error(); }

std::vector<std::shared_ptr<X509>> CertificatesOfPem(const std::string& pem) {
  return AllOfPem<X509>(pem, PEM_read_bio_X509, X509_free);
}

std::vector<std::shared_ptr<X509_CRL>> CrlsOfPem(const std::string& pem) {
  return AllOfPem<X509_CRL>(pem, PEM_read_bio_X509_CRL, X509_CRL_free);
}

std::shared_ptr<EVP_PKEY> PrivateKeyOfPem(const std::string& pem) {
  const ForgottenErrors forgotten;
  const Bio bio = BioOf(pem);
  // OpenSSL would ask for a password on the terminal.
  const auto no_password = [](char*, int, int, void*) { return 0; };
  return {PEM_read_bio_PrivateKey(bio.get(), nullptr, no_password, nullptr), EVP_PKEY_free};
}

std::optional<CertificateTimes> TimesOf(const X509* certificate) {
  const std::optional<Stamp> begin = StampOf(X509_get0_notBefore(certificate));
  const std::optional<Stamp> end = StampOf(X509_get0_notAfter(certificate));
  if (!begin || !end) return std::nullopt;
  return CertificateTimes{*begin, *end};
}

StatusOr<std::string> ReadCertificates(const std::string& kind, const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::string pem, ReadInputFile(kind, path, kMaxPemBytes));
  if (!CertificatesOfPem(pem).empty()) return pem;
  return InvalidArgument("{} '{}': expected a certificate in PEM", kind, path);
}

StatusOr<TlsIdentity> ReadTlsIdentity(const std::string& whose,
                                      const std::string& certificate_path,
                                      const std::string& key_path) {
  const ForgottenErrors forgotten;
  TlsIdentity identity;
  SHIFTMAP_ASSIGN_OR_RETURN(identity.certificates,
                            ReadCertificates(whose + " certificate", certificate_path));
  SHIFTMAP_ASSIGN_OR_RETURN(identity.key, ReadInputFile(whose + " key", key_path, kMaxPemBytes));
  identity.certificate = CertificatesOfPem(identity.certificates).front();
  const std::shared_ptr<EVP_PKEY> key = PrivateKeyOfPem(identity.key);
  if (!key) {
    return InvalidArgument("{} key '{}': expected a private key in PEM", whose, key_path);
  }
  if (X509_check_private_key(identity.certificate.get(), key.get()) == 1) return identity;
  return InvalidArgument(
      "{} key '{}': does not belong to certificate '{}'", whose, key_path, certificate_path);
}

}  // namespace shiftmap
