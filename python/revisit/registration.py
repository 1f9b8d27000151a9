"""How two scans of a place lie to each other. Only in builds with PCL: no wheel has it."""

try:
    from revisit._core.registration import (
        PreparedScan, Registration, RegistrationOptions, register_scans)
except ModuleNotFoundError as error:
    raise ImportError('this build of revisit is without the Point Cloud Library; build with '
                      'libpcl-dev and -DREVISIT_PCL=ON') from error

__all__ = ['PreparedScan', 'Registration', 'RegistrationOptions', 'register_scans']
