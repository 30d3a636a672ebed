"""Random logs of every kind, and an oracle that checks what is made of them: each ends with a map, or with a sentence
that is true.

    scenario   what a log is: world x ways x senses x noise x faults, drawn from a seed, told in one line
    world      the log of a scenario, with its truth
    faults     what goes wrong with logs
    teams      simulated teams of hundreds of poses, drawn from a seed
    real       published logs cut, thinned and renamed, drawn from a seed
    drive      a log through teamslam, by one of its faces, to an outcome
    oracle     what a log determines, from its own rows at the truth: ranks, connections, sigmas, optima
    claims     sentences -> what they state, checked with the oracle
    account    what is left out or remarked -> whether the reason is true
    maps       what every map must be
    truth      that no map costs more than the optimum that the truth leads to
    near       where a map of a published log must lie
    verdict    all of it together; the smallest log that still fails
    known      what of the suite's own logs is known to fail
"""
