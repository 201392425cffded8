"""Records as tables: labelled arrays of xarray, files of netCDF, data frames of pandas."""
