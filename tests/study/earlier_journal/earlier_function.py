def f(x):
    if x == 3:
        raise ValueError("three")
    return {"y": x**2, "z": [x, 2 * x]}
